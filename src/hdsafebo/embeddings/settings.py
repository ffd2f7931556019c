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


class AutoencoderSettings(TrainingSettings):
    """Settings of the variational autoencoders.

    Attributes:
        latent_dim: d; the paper has 16 for field maps and 6 for digits.
        layers: hidden layers of the encoder, and of the decoder.
        hidden: units of a hidden layer.
        warm_start_epochs: of the epochs, how many first regress the principal components' codes; 0 is a
            cold start.
        decoder_sigma: first value of the decoder's standard deviation, in units of the data's.
    """

    latent_dim: Annotated[int, Field(ge=1)] = 16
    layers: Annotated[int, Field(ge=1)] = 4
    hidden: Annotated[int, Field(ge=1)] = 256
    epochs: Annotated[int, Field(ge=1)] = 60
    batch_size: Annotated[int, Field(ge=1)] = 256
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    patience: Annotated[int, Field(ge=1)] = 15
    warm_start_epochs: Annotated[int, Field(ge=0)] = 5
    decoder_sigma: Annotated[float, Field(gt=0)] = 1.0


class IrvaeSettings(AutoencoderSettings):
    """Settings of the isometrically regularised autoencoder.

    Attributes:
        isometry_weight: of the relaxed distortion, in nats per input dimension; the distortion is scaled to
            be 1 at best, so the weight means the same for every d and D.
    """

    isometry_weight: Annotated[float, Field(gt=0)] = 0.1


class ResidualSettings(TrainingSettings):
    """Settings of the residual embedding.

    Attributes:
        latent_dim: d, directions of V.
        residual_dim: directions of W; fewer where the input space has no more.
        layers: hidden layers of h.
        hidden: units of a hidden layer.
        homogeneous: the data are rays from the origin. A training source that only moves points along
            their rays makes no difference then, so it is not called.
        origin: every component of o; None takes the mean of the data.
    """

    latent_dim: Annotated[int, Field(ge=1)] = 16
    residual_dim: Annotated[int, Field(ge=1)] = 128
    layers: Annotated[int, Field(ge=1)] = 3
    hidden: Annotated[int, Field(ge=1)] = 256
    epochs: Annotated[int, Field(ge=1)] = 100
    batch_size: Annotated[int, Field(ge=1)] = 256
    learning_rate: Annotated[float, Field(gt=0)] = 2e-3
    patience: Annotated[int, Field(ge=1)] = 30
    homogeneous: bool = False
    origin: float | None = None

    def directions(self, input_dim: int) -> int:
        """Directions of V and W together."""
        return min(self.latent_dim + self.residual_dim, input_dim)
