"""No embedding: the latent space is the input space."""

from __future__ import annotations

import numpy as np

from hdsafebo.embeddings.base import Embedding, EmbeddingSettings, Source, Tensors
from hdsafebo.embeddings.storage import TensorSpec
from hdsafebo.typing import FloatArray


class IdentitySettings(EmbeddingSettings):
    """Nothing to set."""


class Identity(Embedding):
    """The identity map, a special case of an isometric embedding (paper, section 4.1)."""

    name = "identity"
    Settings = IdentitySettings

    @property
    def latent_dim(self) -> int:
        """D itself."""
        return self.input_dim

    @property
    def _needed_points(self) -> int:
        return 1

    def _fit(self, x: FloatArray, rng: np.random.Generator, source: Source) -> None:
        """Nothing to learn."""

    def _encode(self, x: FloatArray) -> FloatArray:
        return x.copy()

    def _decode(self, z: FloatArray) -> FloatArray:
        return z.copy()

    @classmethod
    def tensor_specs(cls, settings: EmbeddingSettings, input_dim: int) -> dict[str, TensorSpec]:
        """No tensors."""
        return {}

    def tensors(self) -> Tensors:
        """No tensors."""
        return {}

    def _restore(self, tensors: Tensors) -> None:
        """Nothing to restore."""
