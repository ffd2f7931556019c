"""Linear embeddings: principal components, and a random projection as a control."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from hdsafebo.embeddings.base import Embedding, EmbeddingSettings, Source, Tensors
from hdsafebo.embeddings.storage import TensorSpec
from hdsafebo.typing import FloatArray


class LinearSettings(EmbeddingSettings):
    """Settings of the linear embeddings.

    Attributes:
        latent_dim: d; 16 is what the paper uses for field maps.
    """

    latent_dim: Annotated[int, Field(ge=1)] = 16


class LinearEmbedding(Embedding):
    """z = E (x - mean) and x = mean + D z, with E the encoder (d, D) and D the decoder (D, d)."""

    Settings = LinearSettings
    settings: LinearSettings
    _mean: FloatArray
    _encoder: FloatArray
    _decoder: FloatArray

    @property
    def latent_dim(self) -> int:
        """d."""
        return self.settings.latent_dim

    def _encode(self, x: FloatArray) -> FloatArray:
        return (x - self._mean) @ self._encoder.T

    def _decode(self, z: FloatArray) -> FloatArray:
        return self._mean + z @ self._decoder.T

    @classmethod
    def tensor_specs(cls, settings: EmbeddingSettings, input_dim: int) -> dict[str, TensorSpec]:
        """Mean, encoder and decoder, in double precision."""
        assert isinstance(settings, LinearSettings)
        d = settings.latent_dim
        return {
            "mean": TensorSpec((input_dim,), "float64"),
            "encoder": TensorSpec((d, input_dim), "float64"),
            "decoder": TensorSpec((input_dim, d), "float64"),
        }

    def tensors(self) -> Tensors:
        """Mean, encoder and decoder."""
        return {"mean": self._mean, "encoder": self._encoder, "decoder": self._decoder}

    def _restore(self, tensors: Tensors) -> None:
        self._mean, self._encoder, self._decoder = (
            np.asarray(tensors[key], dtype=float) for key in ("mean", "encoder", "decoder")
        )


class PCA(LinearEmbedding):
    """Principal components with scikit-learn's defaults (paper, section 5): isometric on its subspace."""

    name = "pca"

    def _fit(self, x: FloatArray, rng: np.random.Generator, source: Source) -> None:
        from sklearn.decomposition import PCA as ScikitPCA

        seed = int(rng.integers(2**31))  # used only where scikit-learn's default solver is a randomised one
        fitted = ScikitPCA(n_components=self.latent_dim, random_state=seed).fit(source(x, rng))
        self._mean, self._encoder = fitted.mean_, fitted.components_
        self._decoder = np.ascontiguousarray(self._encoder.T)


class RandomProjection(LinearEmbedding):
    """Gaussian random projection with variance 1/d, decoded by its pseudo-inverse.

    Keeps squared distances in expectation (Johnson and Lindenstrauss 1984; Dasgupta and Gupta 2003).
    """

    name = "random"

    def _fit(self, x: FloatArray, rng: np.random.Generator, source: Source) -> None:
        self._mean = source(x, rng).mean(axis=0)
        self._encoder = rng.standard_normal((self.latent_dim, self.input_dim)) / np.sqrt(self.latent_dim)
        self._decoder = np.ascontiguousarray(np.linalg.pinv(self._encoder))
