"""How the residual's network is trained (needs torch): plain regression within the frame."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from hdsafebo.embeddings.base import Source, as_given
from hdsafebo.embeddings.frame import Frame
from hdsafebo.embeddings.mlp import Layers
from hdsafebo.embeddings.settings import ResidualSettings
from hdsafebo.embeddings.training.loop import require_explained, torch_generator, train
from hdsafebo.embeddings.training.tangents import TrainableMlp
from hdsafebo.threads import one_thread
from hdsafebo.typing import FloatArray

LARGEST_UNEXPLAINED = 1.0  # of the residual: worse than none at all
ADVICE = "set learning_rate lower or epochs higher; where the codes say nothing about the residual, use 'pca'"


def fit_network(
    name: str,
    settings: ResidualSettings,
    frame: Frame,
    x: FloatArray,
    rng: np.random.Generator,
    source: Source,
) -> tuple[Layers, dict[str, object]]:
    """Train h on points (n, D); EmbeddingTrainingError if it diverges or is worse than no residual."""
    with one_thread():
        model = ResidualRegression(settings, frame, x, rng, source)
        history = train(name, model, settings)
        require_explained(name, model.unexplained(), LARGEST_UNEXPLAINED, ADVICE)
    return model.network.layers(), history


class ResidualRegression:
    """Inputs and targets of h, side by side in one table (n, d + r)."""

    def __init__(
        self,
        settings: ResidualSettings,
        frame: Frame,
        x: FloatArray,
        rng: np.random.Generator,
        source: Source,
    ) -> None:
        self._frame, self._rng, self._source = frame, rng, source
        shuffled = rng.permutation(len(x))
        held_out = max(1, round(settings.validation_share * len(x)))
        self._x = x[shuffled[held_out:]]
        self._fixed = self._table(self._x) if source is as_given else None
        self._held_out = self._table(x[shuffled[:held_out]])
        d, columns = settings.latent_dim, self._held_out.shape[1]
        sizes = [d, *[settings.hidden] * settings.layers, columns - d]
        self.network = TrainableMlp(sizes, torch_generator(rng))
        self._split = [d, columns - d]

    @property
    def parameters(self) -> list[Tensor]:
        """The network's."""
        return self.network.parameters

    def epoch(self) -> Tensor:
        """Shuffled training pairs."""
        order = self._rng.permutation(len(self._x))
        return self._table(self._x[order]) if self._fixed is None else self._fixed[torch.from_numpy(order)]

    def loss(self, batch: Tensor) -> Tensor:
        """Mean squared error of the residual."""
        inputs, targets = batch.split(self._split, dim=1)
        return (self.network(inputs) - targets).square().mean()

    def unexplained(self) -> float:
        """Held-out share of the residual's square that the network does not give."""
        with torch.no_grad():
            inputs, targets = self._held_out.split(self._split, dim=1)
            return float((self.network(inputs) - targets).square().sum() / targets.square().sum())

    def _table(self, x: FloatArray) -> Tensor:
        pairs = np.concatenate(self._frame.pairs(self._source(x, self._rng)), axis=1)
        return torch.from_numpy(pairs.astype(np.float32))
