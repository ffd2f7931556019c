"""Policies whose actions move along few directions: an embedding that a search can run through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdsafebo.errors import ProblemError
from hdsafebo.typing import FloatArray

_ORTHONORMAL = 1e-8


@dataclass(frozen=True)
class ActionSynergies:
    """Codes are weights with one row per synergy; inputs are `centre` + basis' codes.

    Attributes:
        basis: (rows, k) orthonormal rows, one synergy each.
        centre: (D,) policy of the code 0, D = k (o + 1).

    Raises:
        ProblemError: the basis is not orthonormal, or does not fit the centre.
    """

    basis: FloatArray
    centre: FloatArray

    def __post_init__(self) -> None:
        rows, k = self.basis.shape
        if self.centre.ndim != 1 or len(self.centre) % k:
            raise ProblemError(f"centre {self.centre.shape} does not fit synergies of {k} actions")
        error = np.abs(self.basis @ self.basis.T - np.eye(rows)).max()
        if error > _ORTHONORMAL:
            raise ProblemError(f"rows of the synergies differ by {error:.2g} from orthonormal ones")

    @classmethod
    def of_directions(cls, directions: FloatArray, centre: FloatArray) -> ActionSynergies:
        """Over the span of (rows, k) linearly independent directions.

        Raises:
            ProblemError: they are not linearly independent.
        """
        if np.linalg.matrix_rank(directions) < len(directions):
            raise ProblemError(f"{len(directions)} synergies are not linearly independent")
        basis, _ = np.linalg.qr(directions.T)
        return cls(basis.T.copy(), centre)

    @property
    def dimension(self) -> int:
        """Number of weights of a code."""
        return len(self.basis) * (len(self.centre) // self.basis.shape[1])

    def decode(self, z: FloatArray) -> FloatArray:
        """(n, D) policies of (n, d) codes."""
        rows = np.asarray(z, float).reshape(len(z), len(self.basis), -1)
        return np.asarray(self.centre + (self.basis.T @ rows).reshape(len(z), -1))

    def encode(self, x: FloatArray) -> FloatArray:
        """(n, d) codes of (n, D) policies: of the part in the span of the synergies."""
        rows = (np.asarray(x, float) - self.centre).reshape(len(x), self.basis.shape[1], -1)
        return np.asarray((self.basis @ rows).reshape(len(x), -1))

    def compose(self, matrix: FloatArray) -> FloatArray:
        """(p, d) the linear map that (p, D) `matrix` is after decoding."""
        return self.encode(np.asarray(matrix, float) + self.centre)
