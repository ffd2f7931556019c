"""Variational autoencoders, with isometric regularisation (IRVAE) and without (VAE).

Both have the paper's architecture (appendix, table of the autoencoder model): four hidden layers of 256
units in encoder and decoder. A cold start on field maps collapses to the mean map, since their pixels are
nearly constant; so inputs are centred and scaled, the decoder's noise starts at the scale of the data,
and both networks first learn the principal components' codes.
"""

from __future__ import annotations

import numpy as np

from hdsafebo.embeddings.base import Embedding, EmbeddingSettings, Source, Tensors
from hdsafebo.embeddings.mlp import Layers, forward, mlp_layers, mlp_specs, mlp_tensors
from hdsafebo.embeddings.settings import AutoencoderSettings, IrvaeSettings
from hdsafebo.embeddings.storage import TensorSpec
from hdsafebo.typing import FloatArray


class VAE(Embedding):
    """A conventional variational autoencoder (Kingma and Welling 2014), the paper's control."""

    name = "vae"
    Settings = AutoencoderSettings
    settings: AutoencoderSettings
    _mean: FloatArray
    _scale: FloatArray
    _encoder: Layers
    _decoder: Layers

    @property
    def latent_dim(self) -> int:
        """d."""
        return self.settings.latent_dim

    def _fit(self, x: FloatArray, rng: np.random.Generator, source: Source) -> None:
        from hdsafebo.embeddings.training.autoencoder import fit_autoencoder

        fitted = fit_autoencoder(self.name, self.settings, self._isometry_weight, x, rng, source)
        self._mean, self._scale = fitted.mean, np.array([fitted.scale])
        self._encoder, self._decoder = fitted.encoder, fitted.decoder
        self.training = fitted.history

    @property
    def _isometry_weight(self) -> float:
        return 0.0

    def _encode(self, x: FloatArray) -> FloatArray:
        return forward(self._encoder, (x - self._mean) / self._scale)

    def _decode(self, z: FloatArray) -> FloatArray:
        return self._mean + self._scale * forward(self._decoder, z)

    @classmethod
    def tensor_specs(cls, settings: EmbeddingSettings, input_dim: int) -> dict[str, TensorSpec]:
        """Mean and scale of the inputs, and both networks; of the encoder what gives the mean code."""
        assert isinstance(settings, AutoencoderSettings)
        hidden = [settings.hidden] * settings.layers
        return {
            "mean": TensorSpec((input_dim,), "float64"),
            "scale": TensorSpec((1,), "float64"),
            **mlp_specs("encoder", [input_dim, *hidden, settings.latent_dim]),
            **mlp_specs("decoder", [settings.latent_dim, *hidden, input_dim]),
        }

    def tensors(self) -> Tensors:
        """Mean, scale, encoder and decoder."""
        return {
            "mean": self._mean,
            "scale": self._scale,
            **mlp_tensors("encoder", self._encoder),
            **mlp_tensors("decoder", self._decoder),
        }

    def _restore(self, tensors: Tensors) -> None:
        self._mean, self._scale = (np.asarray(tensors[key], dtype=float) for key in ("mean", "scale"))
        self._encoder, self._decoder = mlp_layers("encoder", tensors), mlp_layers("decoder", tensors)


class IRVAE(VAE):
    """The paper's embedding: the decoder is regularised towards a scaled isometry (Lee et al. 2022)."""

    name = "irvae"
    Settings = IrvaeSettings
    settings: IrvaeSettings

    @property
    def _isometry_weight(self) -> float:
        return self.settings.isometry_weight
