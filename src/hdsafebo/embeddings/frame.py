"""The linear frame of the residual embedding: principal directions, and what they leave out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hdsafebo.embeddings.settings import ResidualSettings
from hdsafebo.typing import FloatArray


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


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
