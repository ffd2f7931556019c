"""Settings that all learned embeddings share (apart from the loop, which needs torch)."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from hdsafebo.embeddings.base import EmbeddingSettings


class TrainingSettings(EmbeddingSettings):
    """How a learned embedding is trained.

    Attributes:
        epochs: passes over the data.
        batch_size: points per step.
        learning_rate: of Adam at the start; it falls along a cosine to a hundredth.
        validation_share: share of the points that is held out to measure progress.
        patience: epochs without a new best held-out measure after which training stops.
    """

    epochs: Annotated[int, Field(ge=1)]
    batch_size: Annotated[int, Field(ge=1)]
    learning_rate: Annotated[float, Field(gt=0)]
    validation_share: Annotated[float, Field(gt=0, lt=1)] = 0.1
    patience: Annotated[int, Field(ge=1)]
