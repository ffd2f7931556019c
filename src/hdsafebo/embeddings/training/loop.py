"""The training loop that the learned embeddings share: Adam, a held-out measure, early stop, collapse."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from hdsafebo.embeddings.settings import TrainingSettings
from hdsafebo.errors import EmbeddingTrainingError
from hdsafebo.progress import progress

FINAL_RATE = 0.01  # of the first learning rate, at the end of the cosine


class Model(Protocol):
    """What the loop trains.

    Attributes:
        parameters: tensors with gradients.
    """

    @property
    def parameters(self) -> list[Tensor]: ...

    def epoch(self) -> Tensor:
        """The training points of a new epoch, in the order in which they are used; shape (n, k)."""

    def loss(self, batch: Tensor) -> Tensor:
        """Loss of a batch (b, k), a scalar."""

    def unexplained(self) -> float:
        """The held-out measure: share of the variance that decoding does not give back."""


def train(name: str, model: Model, settings: TrainingSettings) -> dict[str, object]:
    """Train a model and leave it with the weights of its best held-out measure.

    Args:
        name: of the embedding, for progress and errors.
        model: what is trained, in place.
        settings: how.

    Returns:
        The history: `unexplained` per epoch, `best_epoch` (from 1) and `stopped_early`.

    Raises:
        EmbeddingTrainingError: the loss or the measure is no longer finite.
    """
    optimizer = torch.optim.Adam(model.parameters, settings.learning_rate)
    history: list[float] = []
    best, kept = math.inf, [p.detach().clone() for p in model.parameters]
    with progress(settings.epochs, f"train {name}") as advance:
        for epoch in range(settings.epochs):
            _one_epoch(name, model, optimizer, settings, epoch)
            history.append(model.unexplained())
            advance(note=f"unexplained variance {history[-1]:.2e}")
            if history[-1] < best:
                best, kept = history[-1], [p.detach().clone() for p in model.parameters]
            if epoch - int(np.argmin(history)) >= settings.patience:
                break
    with torch.no_grad():
        for parameter, value in zip(model.parameters, kept, strict=True):
            parameter.copy_(value)
    return {
        "unexplained": history,
        "best_epoch": int(np.argmin(history)) + 1,
        "stopped_early": len(history) < settings.epochs,
    }


def require_explained(name: str, unexplained: float, limit: float, advice: str) -> None:
    """Refuse a collapsed model.

    Raises:
        EmbeddingTrainingError: more than `limit` of the held-out variance is unexplained; the message
            gives the measured value, the limit and what to do.
    """
    if not unexplained <= limit:
        raise EmbeddingTrainingError(
            f"embedding {name!r} collapsed: {unexplained:.1%} of the held-out variance is unexplained, "
            f"expected at most {limit:.0%}; {advice}"
        )


def torch_generator(rng: np.random.Generator) -> torch.Generator:
    """A torch generator seeded from a NumPy one."""
    return torch.Generator().manual_seed(int(rng.integers(2**63)))


def _one_epoch(
    name: str, model: Model, optimizer: torch.optim.Adam, settings: TrainingSettings, epoch: int
) -> None:
    batches = model.epoch().split(settings.batch_size)
    for index, batch in enumerate(batches):
        progressed = (epoch + index / len(batches)) / settings.epochs
        rate = FINAL_RATE + (1.0 - FINAL_RATE) * 0.5 * (1.0 + math.cos(math.pi * progressed))
        optimizer.param_groups[0]["lr"] = rate * settings.learning_rate
        optimizer.zero_grad()
        loss = model.loss(batch)
        if not torch.isfinite(loss):
            raise EmbeddingTrainingError(
                f"embedding {name!r} diverged: the loss is {float(loss.detach())} in epoch {epoch + 1}; "
                f"set learning_rate below {settings.learning_rate:g}"
            )
        loss.backward()
        optimizer.step()
