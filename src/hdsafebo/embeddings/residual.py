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

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from hdsafebo.embeddings.base import Embedding, EmbeddingSettings, Source, Tensors, as_given
from hdsafebo.embeddings.mlp import Layers, forward, mlp_layers, mlp_specs, mlp_tensors
from hdsafebo.embeddings.storage import TensorSpec
from hdsafebo.embeddings.training_settings import TrainingSettings
from hdsafebo.problem import FloatArray


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


@dataclass(frozen=True)
class Frame:
    """The linear part of the embedding.

    Attributes:
        origin: o, shape (D,).
        directions: V then W, shape (D, d + r), orthonormal columns.
        code_scale: root mean square of all codes.
        residual_scale: a, root mean square of the components along W over r(z).
        latent_dim: d.
        homogeneous: r(z) is the root mean square of the code itself.
    """

    origin: FloatArray
    directions: FloatArray
    code_scale: float
    residual_scale: float
    latent_dim: int
    homogeneous: bool

    @classmethod
    def of(cls, x: FloatArray, settings: ResidualSettings) -> Frame:
        """The principal frame of points (n, D)."""
        origin = x.mean(axis=0) if settings.origin is None else np.full(x.shape[1], settings.origin)
        _, vectors = np.linalg.eigh((x - origin).T @ (x - origin))
        directions = np.ascontiguousarray(vectors[:, ::-1][:, : settings.directions(x.shape[1])])
        unscaled = cls(origin, directions, 1.0, 1.0, settings.latent_dim, settings.homogeneous)
        codes, rest = unscaled.split(x)
        scaled = replace(unscaled, code_scale=_rms(codes))
        return replace(scaled, residual_scale=_rms(rest / scaled.radius(codes)))

    def split(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Codes (n, d) of points (n, D), and their components (n, r) along W."""
        components = (x - self.origin) @ self.directions
        return components[:, : self.latent_dim], components[:, self.latent_dim :]

    def join(self, codes: FloatArray, rest: FloatArray) -> FloatArray:
        """The inverse of `split` within the frame's directions."""
        return self.origin + np.concatenate([codes, rest], axis=1) @ self.directions.T

    def radius(self, codes: FloatArray) -> FloatArray:
        """r(z), shape (n, 1)."""
        if self.homogeneous:
            return np.linalg.norm(codes, axis=1, keepdims=True) / np.sqrt(self.latent_dim)
        return np.full((len(codes), 1), self.code_scale)

    def inputs(self, codes: FloatArray) -> FloatArray:
        """z / r(z), shape (n, d); 0 at the origin of rays."""
        radius = self.radius(codes)
        return np.divide(codes, radius, out=np.zeros_like(codes), where=radius > 0)

    def pairs(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What h must learn: inputs (n, d) and outputs (n, r) for points (n, D), none at the origin."""
        codes, rest = self.split(x)
        return self.inputs(codes), rest / (self.residual_scale * self.radius(codes))


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
        from hdsafebo.embeddings.residual_training import fit_network

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


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
