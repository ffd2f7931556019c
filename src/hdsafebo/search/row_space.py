"""What kernel inputs see of the steps of a searched space, and what they hide.

Of a step in d dimensions, p kernel inputs show at most p numbers. Steps can therefore be drawn, judged and
climbed in that many numbers, and only those that are chosen need d.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdsafebo.search.metric import Metric
from hdsafebo.typing import FloatArray

_NEGLIGIBLE = 1e-10
"""Squared singular values below it, in units of the largest, are rounding."""
_FAR = 1e4
"""Half the side of the box that an ascent in the visible space is given: none that it ever meets."""


@dataclass(frozen=True)
class RowSpace:
    """The r directions of the unit cube that change kernel inputs.

    Attributes:
        basis: (r, d) orthonormal steps in the unit cube.
        image: (p, r) changes of the kernel inputs along them.
    """

    basis: FloatArray
    image: FloatArray

    @classmethod
    def of(cls, metric: Metric) -> RowSpace:
        """The row space of a metric with a full matrix, from the eigenvectors of A A'."""
        values, vectors = np.linalg.eigh(metric.matrix @ metric.matrix.T)
        kept = values > _NEGLIGIBLE * values[-1]
        root = np.sqrt(values[kept])
        return cls((vectors[:, kept] / root).T @ metric.matrix, vectors[:, kept] * root)

    @property
    def rank(self) -> int:
        """r."""
        return len(self.basis)

    def completed(self, visible: FloatArray, rng: np.random.Generator) -> FloatArray:
        """(n, d) standard normal steps, given what is visible of them.

        Args:
            visible: (n, r) their components along the basis.
            rng: source of the hidden components.
        """
        steps = rng.standard_normal((len(visible), self.basis.shape[1]))
        steps += (visible - steps @ self.basis.T) @ self.basis
        return steps

    def around(self, inputs: FloatArray) -> tuple[Metric, FloatArray]:
        """The visible space about a point as a cube of its own, in which an ascent costs r instead of d.

        Args:
            inputs: (p,) kernel inputs of the point.

        Returns:
            The metric of that cube, and (r,) where in it the point lies.
        """
        middle = np.full(self.rank, 0.5)
        matrix = 2.0 * _FAR * self.image
        return Metric(matrix, inputs - matrix @ middle), middle

    def lifted(self, points: FloatArray) -> FloatArray:
        """(n, d) steps in the unit cube, without a hidden part, of (n, r) points of the cube of `around`."""
        return 2.0 * _FAR * (points - 0.5) @ self.basis
