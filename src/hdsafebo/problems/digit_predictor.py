"""A convolutional network that recognises digits (paper, appendix: a two-layer CNN)."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import nn

from hdsafebo.errors import DatasetError, EmbeddingTrainingError
from hdsafebo.files.bounded import require_regular
from hdsafebo.problems.digit_images import DigitImages
from hdsafebo.progress import progress
from hdsafebo.threads import one_thread
from hdsafebo.typing import FloatArray

_CHANNELS = (16, 32)
_BATCH = 64
_LEARNING_RATE = 1e-3
_FORMAT = "digit-predictor"
MEDIAN_MARGIN = 600.0
"""Of the trained network's outputs, the median lead of the right digit over the next one. The paper divides
by a temperature of 200 the outputs of a network whose scale it does not publish, because its probabilities
are nearly all 0 or 1. At this scale a temperature of 1 gives such probabilities, and one of 200 gives half of
the images a probability above 0.95 and about 5 % less than 0.5."""


class DigitPredictor:
    """Probabilities of the ten digits for images of one size.

    Args:
        side: pixels along one edge; a multiple of 4.
    """

    def __init__(self, side: int) -> None:
        if side < 4 or side % 4:
            raise DatasetError(f"digit predictor: images of {side} x {side} pixels, expected a multiple of 4")
        self.side = side
        self._network = _network(side)

    def fit(self, images: DigitImages, *, epochs: int, rng: np.random.Generator) -> float:
        """Train on four fifths of the images; returns the accuracy on the rest.

        The outputs are scaled to `MEDIAN_MARGIN` on the images that it was trained on.

        Args:
            images: what to learn.
            epochs: passes over the training images.
            rng: decides the split, the initial weights and the order.

        Raises:
            EmbeddingTrainingError: the network recognises the held-out images hardly better than chance.
        """
        order = rng.permutation(len(images.labels))
        held_out, training = np.split(order, [len(order) // 5])
        x, y = self._tensor(images.pixels), torch.as_tensor(images.labels)
        with torch.random.fork_rng():
            torch.manual_seed(int(rng.integers(2**31)))
            self._network = _network(self.side)
        optimizer = torch.optim.Adam(self._network.parameters(), lr=_LEARNING_RATE)
        with one_thread(), progress(epochs, "digit predictor") as advance:
            for _ in range(epochs):
                loss = 0.0
                for rows in np.array_split(rng.permutation(training), max(1, len(training) // _BATCH)):
                    optimizer.zero_grad()
                    value = nn.functional.cross_entropy(self._network(x[rows]), y[rows])
                    value.backward()
                    optimizer.step()
                    loss = value.item()
                advance(note=f"loss {loss:.3f}")
        self._scale_outputs(images.pixels[training], images.labels[training])
        predicted = self.logits(images.pixels[held_out]).argmax(axis=1)
        accuracy = float((predicted == images.labels[held_out]).mean())
        if accuracy < 0.5:
            raise EmbeddingTrainingError(
                f"digit predictor: accuracy {accuracy:.2f} on held-out images after {epochs} epochs, "
                "expected at least 0.5; raise digits.predictor_epochs"
            )
        return accuracy

    def _scale_outputs(self, pixels: FloatArray, labels: NDArray[np.int64]) -> None:
        """Scale the last layer to a median margin of `MEDIAN_MARGIN`; a useless network stays as it is."""
        outputs = self.logits(pixels)
        right = np.arange(10) == labels[:, None]
        margin = float(np.median(outputs[right] - np.where(right, -np.inf, outputs).max(axis=1)))
        if margin > 0:
            with torch.no_grad():
                for weight in self._network[-1].parameters():
                    weight.mul_(MEDIAN_MARGIN / margin)

    def logits(self, pixels: FloatArray) -> FloatArray:
        """(n, 10) outputs before the softmax of (n, side * side) images."""
        with torch.no_grad():
            return np.asarray(self._network(self._tensor(pixels)).numpy(), float)

    def probability(self, pixels: FloatArray, digit: int, temperature: float) -> FloatArray:
        """(n,) softmax probability of a digit at a temperature (paper, appendix: the CNN is very sharp)."""
        scaled = self.logits(pixels) / temperature
        scaled -= scaled.max(axis=1, keepdims=True)
        weights = np.exp(scaled)
        return np.asarray(weights[:, digit] / weights.sum(axis=1))

    def save(self, path: Path) -> None:
        """Write the weights as safetensors."""
        path.parent.mkdir(parents=True, exist_ok=True)
        state = {k: v.contiguous() for k, v in self._network.state_dict().items()}
        save_file(state, path, metadata={"format": _FORMAT, "card": json.dumps({"side": self.side})})

    @classmethod
    def load(cls, path: Path) -> DigitPredictor:
        """Read weights; DatasetError when the file is missing, damaged or of something else."""
        try:
            require_regular(path)
            with safe_open(path, "pt") as file:
                metadata = file.metadata() or {}
                if metadata.get("format") != _FORMAT:
                    raise DatasetError(f"{path}: format is {metadata.get('format')!r}, expected {_FORMAT!r}")
                predictor = cls(int(json.loads(metadata["card"])["side"]))
                state = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118  (no mapping)
            if not all(bool(torch.isfinite(weight).all()) for weight in state.values()):
                raise DatasetError(f"{path}: holds weights that are not finite")
            predictor._network.load_state_dict(state)
        except (OSError, SafetensorError, ValueError, KeyError, TypeError, RuntimeError) as error:
            raise DatasetError(f"{path}: not a digit predictor: {error}") from error
        return predictor

    def _tensor(self, pixels: NDArray[np.float64]) -> torch.Tensor:
        if pixels.ndim != 2 or pixels.shape[1] != self.side**2:
            raise DatasetError(f"digit images have shape {pixels.shape}, expected (n, {self.side**2})")
        return torch.as_tensor(pixels, dtype=torch.float32).reshape(-1, 1, self.side, self.side)


def _network(side: int) -> nn.Sequential:
    first, second = _CHANNELS
    return nn.Sequential(
        nn.Conv2d(1, first, 3, padding=1),
        nn.ReLU(),
        nn.MaxPool2d(2),
        nn.Conv2d(first, second, 3, padding=1),
        nn.ReLU(),
        nn.MaxPool2d(2),
        nn.Flatten(),
        nn.Linear(second * (side // 4) ** 2, 10),
    )
