"""How a variational autoencoder, isometric or not, is trained (needs torch)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from hdsafebo.embeddings.base import Source
from hdsafebo.embeddings.linear import PCA, LinearSettings
from hdsafebo.embeddings.mlp import Layer, Layers
from hdsafebo.embeddings.settings import AutoencoderSettings
from hdsafebo.embeddings.training.loop import require_explained, torch_generator, train
from hdsafebo.embeddings.training.tangents import TrainableMlp, relaxed_distortion
from hdsafebo.threads import one_thread
from hdsafebo.typing import FloatArray

MIX_MARGIN = 0.2  # codes are mixed with weights in [-0.2, 1.2] (Lee et al. 2022, eta)
LARGEST_UNEXPLAINED = 0.8  # a collapsed autoencoder decodes the mean, which leaves 1.0
ADVICE = "set warm_start_epochs to 1 or more, decoder_sigma below 1, or learning_rate lower"


@dataclass(frozen=True)
class FittedAutoencoder:
    """Mean (D,) and scale of the inputs, encoder of the mean code, decoder, history of the training."""

    mean: FloatArray
    scale: float
    encoder: Layers
    decoder: Layers
    history: dict[str, object]


def fit_autoencoder(
    name: str,
    settings: AutoencoderSettings,
    isometry_weight: float,
    x: FloatArray,
    rng: np.random.Generator,
    source: Source,
) -> FittedAutoencoder:
    """Train on points (n, D); EmbeddingTrainingError if it diverges or collapses."""
    with one_thread():
        data = EpochData(x, settings.validation_share, rng, source)
        networks = Networks(x.shape[1], settings, torch_generator(rng))
        history: dict[str, object] = {}
        if settings.warm_start_epochs:
            warm = WarmStartTask(networks, data)
            phase = settings.model_copy(update={"epochs": settings.warm_start_epochs})
            history["warm_start"] = train(f"{name} (warm start)", warm, phase)
        bound = EvidenceBound(networks, data, isometry_weight)
        history.update(train(name, bound, settings))
        history["decoder_sigma"] = float(networks.log_sigma.detach().exp())
        require_explained(name, bound.unexplained(), LARGEST_UNEXPLAINED, ADVICE)
    d = settings.latent_dim
    *hidden, last = networks.encoder.layers()
    mean_code = Layer(last.weight[:d], last.bias[:d])
    return FittedAutoencoder(data.mean, data.scale, [*hidden, mean_code], networks.decoder.layers(), history)


class EpochData:
    """Centred and scaled points: a fresh variation of the training ones per epoch, fixed held-out ones."""

    def __init__(
        self, x: FloatArray, held_out_share: float, rng: np.random.Generator, source: Source
    ) -> None:
        self._rng, self._source = rng, source
        shuffled = rng.permutation(len(x))
        held_out = max(1, round(held_out_share * len(x)))
        self._x = x[shuffled[held_out:]]
        drawn = source(self._x, rng)
        self.mean = drawn.mean(axis=0)
        self.scale = float((drawn - self.mean).std())
        self.held_out = self._scaled(source(x[shuffled[:held_out]], rng))

    def epoch(self) -> Tensor:
        """Shuffled training points, float32."""
        return self._scaled(self._source(self._x[self._rng.permutation(len(self._x))], self._rng))

    def _scaled(self, x: FloatArray) -> Tensor:
        return torch.from_numpy(((x - self.mean) / self.scale).astype(np.float32))


class Networks:
    """Encoder to mean and log variance of a code, decoder, and the decoder's log standard deviation."""

    def __init__(self, inputs: int, settings: AutoencoderSettings, generator: torch.Generator) -> None:
        hidden = [settings.hidden] * settings.layers
        self.latent_dim, self.generator = settings.latent_dim, generator
        self.encoder = TrainableMlp([inputs, *hidden, 2 * self.latent_dim], generator)
        self.decoder = TrainableMlp([self.latent_dim, *hidden, inputs], generator)
        self.log_sigma = torch.tensor(float(np.log(settings.decoder_sigma)), requires_grad=True)

    @property
    def parameters(self) -> list[Tensor]:
        """Everything that is trained."""
        return [*self.encoder.parameters, *self.decoder.parameters, self.log_sigma]

    def posterior(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log variance (n, d) of the codes of points (n, D)."""
        mean, log_variance = self.encoder(x).split(self.latent_dim, dim=1)
        return mean, log_variance

    def unexplained(self, x: Tensor) -> float:
        """Share of the variance of points (n, D) that decoding their mean codes does not give back."""
        with torch.no_grad():
            error = self.decoder(self.posterior(x)[0]) - x
            return float(error.square().sum() / (x - x.mean(dim=0)).square().sum())


class WarmStartTask:
    """First task of the networks: encode to principal components' codes, decode from them.

    The codes are scaled by one number to unit mean variance, as the prior of the codes has it, which
    keeps them a scaled isometry.
    """

    def __init__(self, networks: Networks, data: EpochData) -> None:
        self._networks, self._data = networks, data
        components = PCA(LinearSettings(latent_dim=networks.latent_dim))
        first = data.epoch().numpy()
        codes = components.fit(first, rng=np.random.default_rng(0)).encode(first)
        encoder = components.tensors()["encoder"] / np.sqrt((codes**2).mean())
        self._encoder = torch.from_numpy(encoder.astype(np.float32))

    @property
    def parameters(self) -> list[Tensor]:
        """Both networks."""
        return [*self._networks.encoder.parameters, *self._networks.decoder.parameters]

    def epoch(self) -> Tensor:
        """Points of a new epoch."""
        return self._data.epoch()

    def loss(self, batch: Tensor) -> Tensor:
        """Mean squared errors of codes and of decoded points."""
        codes = batch @ self._encoder.T
        encoded = self._networks.posterior(batch)[0]
        decoded = self._networks.decoder(codes)
        return (encoded - codes).square().mean() + (decoded - batch).square().mean()

    def unexplained(self) -> float:
        """Of the held-out points."""
        return self._networks.unexplained(self._data.held_out)


class EvidenceBound:
    """The task itself: the negative evidence lower bound and the weighted isometry term.

    Per point (D/2 (r^2/s^2 + log s^2) + KL) / D, with r^2 the mean squared error of a decoded sample of the
    code and s the decoder's learned standard deviation (Kingma and Welling 2014); per batch d times the
    relaxed distortion at random mixtures of its codes (Lee et al. 2022), which is 1 at best.
    """

    def __init__(self, networks: Networks, data: EpochData, isometry_weight: float) -> None:
        self._networks, self._data, self._weight = networks, data, isometry_weight

    @property
    def parameters(self) -> list[Tensor]:
        """Everything that is trained."""
        return self._networks.parameters

    def epoch(self) -> Tensor:
        """Points of a new epoch."""
        return self._data.epoch()

    def loss(self, batch: Tensor) -> Tensor:
        """Mean over the batch (b, D)."""
        networks = self._networks
        mean, log_variance = networks.posterior(batch)
        z = mean + (0.5 * log_variance).exp() * self._normal(mean)
        error = (networks.decoder(z) - batch).square().sum(dim=1)
        pixels, log_sigma = batch.shape[1], networks.log_sigma
        misfit = 0.5 * error * (-2.0 * log_sigma).exp() + pixels * log_sigma
        divergence = 0.5 * (mean.square() + log_variance.exp() - 1.0 - log_variance).sum(dim=1)
        loss = (misfit + divergence).mean() / pixels
        if not self._weight:
            return loss
        return loss + self._weight * networks.latent_dim * self._distortion(z)

    def unexplained(self) -> float:
        """Of the held-out points."""
        return self._networks.unexplained(self._data.held_out)

    def _distortion(self, z: Tensor) -> Tensor:
        generator = self._networks.generator
        other = z[torch.randperm(len(z), generator=generator)]
        share = torch.rand((len(z), 1), generator=generator) * (1.0 + 2.0 * MIX_MARGIN) - MIX_MARGIN
        mixed = share * z + (1.0 - share) * other
        pullback = self._networks.decoder.pullback(mixed, self._normal(mixed))
        return relaxed_distortion(pullback.tangent, pullback.cotangent)

    def _normal(self, like: Tensor) -> Tensor:
        return torch.randn(like.shape, generator=self._networks.generator)
