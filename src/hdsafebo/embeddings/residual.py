"""A linear code with a learned residual in the decoder: isometric by construction, invertible on the data.

The encoder projects on the leading principal directions V, which keep distances almost perfectly on field
maps; but decoding with V alone confuses neighbouring configurations. What the projection leaves out is, on
the data, a function of the code, so a small perceptron h adds it within the next directions W:

    z = V'(x - o),        x = o + V z + a r(z) W h(z / r(z)),

with r the root mean square of all codes or, for data made of rays from o (field maps: rays in the
current), of the code itself: then decoding is homogeneous as the data are. Since W is orthogonal to V,
encoding a decoded code gives it back exactly, whatever h is.
"""

from __future__ import annotations

import numpy as np

from hdsafebo.embeddings.base import Embedding, EmbeddingSettings, Source, Tensors, as_given
from hdsafebo.embeddings.frame import Frame
from hdsafebo.embeddings.mlp import Layers, forward, mlp_layers, mlp_specs, mlp_tensors
from hdsafebo.embeddings.settings import ResidualSettings
from hdsafebo.embeddings.storage import TensorSpec
from hdsafebo.typing import FloatArray


class Residual(Embedding):
    """Principal components with a learned residual in the decoder."""

    name = "residual"
    Settings = ResidualSettings
    settings: ResidualSettings
    _frame: Frame
    _network: Layers

    @property
    def latent_dim(self) -> int:
        """d."""
        return self.settings.latent_dim

    @property
    def _needed_points(self) -> int:
        return self.latent_dim + 1  # so that a direction is left for the residual

    def _fit(self, x: FloatArray, rng: np.random.Generator, source: Source) -> None:
        from hdsafebo.embeddings.training.residual import fit_network

        drawn = as_given if self.settings.homogeneous else source
        self._frame = Frame.of(drawn(x, rng), self.settings)
        self._network, self.training = fit_network(self.name, self.settings, self._frame, x, rng, drawn)

    def _encode(self, x: FloatArray) -> FloatArray:
        return self._frame.split(x)[0]

    def _decode(self, z: FloatArray) -> FloatArray:
        frame = self._frame
        rest = frame.residual_scale * frame.radius(z) * forward(self._network, frame.inputs(z))
        return frame.join(z, rest)

    @classmethod
    def tensor_specs(cls, settings: EmbeddingSettings, input_dim: int) -> dict[str, TensorSpec]:
        """Origin, directions and scales of the frame in double precision, and the network."""
        assert isinstance(settings, ResidualSettings)
        directions = settings.directions(input_dim)
        hidden = [settings.hidden] * settings.layers
        return {
            "origin": TensorSpec((input_dim,), "float64"),
            "directions": TensorSpec((input_dim, directions), "float64"),
            "scales": TensorSpec((2,), "float64"),
            **mlp_specs("network", [settings.latent_dim, *hidden, max(0, directions - settings.latent_dim)]),
        }

    def tensors(self) -> Tensors:
        """Frame and network."""
        frame = self._frame
        return {
            "origin": frame.origin,
            "directions": frame.directions,
            "scales": np.array([frame.code_scale, frame.residual_scale]),
            **mlp_tensors("network", self._network),
        }

    def _restore(self, tensors: Tensors) -> None:
        origin, directions, scales = (
            np.asarray(tensors[key], dtype=float) for key in ("origin", "directions", "scales")
        )
        settings = self.settings
        self._frame = Frame(
            origin, directions, float(scales[0]), float(scales[1]), settings.latent_dim, settings.homogeneous
        )
        self._network = mlp_layers("network", tensors)
