"""A sample path of a Gaussian process, revealed where and when it is asked for."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from hdsafebo.gp.kernel import exact_distances, matern52
from hdsafebo.typing import FloatArray

_LEAST_VARIANCE = 1e-12


class GaussianPath:
    """One draw of a zero-mean, unit-variance Matern-5/2 process with observation noise.

    Each value is drawn from its distribution given all values revealed before, through a Cholesky factor
    that grows by a row per point (n^2 operations). The values are those that L z gives with the factor L
    of the covariance of all points at once: exact, at any dimension, without a grid.

    Args:
        dimension: of the inputs.
        length_scale: of the kernel, in the inputs' units.
        noise_variance: variance of the observation noise.
        rng: source of randomness, used for nothing else.
    """

    def __init__(
        self, dimension: int, length_scale: float, noise_variance: float, rng: np.random.Generator
    ) -> None:
        self._length_scale = length_scale
        self._noise = noise_variance
        self._rng = rng
        self._inputs = np.empty((0, dimension))
        self._factor = np.empty((0, 0))
        self._normals = np.empty(0)

    def __call__(self, x: FloatArray) -> FloatArray:
        """(n,) observations at the (n, p) inputs, given everything observed before."""
        n, new = len(self._inputs), len(x)
        self._inputs = np.concatenate([self._inputs, x])
        self._normals = np.concatenate([self._normals, self._rng.standard_normal(new)])
        factor = np.zeros((n + new, n + new))
        factor[:n, :n] = self._factor
        covariance = matern52(exact_distances(x, self._inputs), self._length_scale)
        values = np.empty(new)
        for i in range(n, n + new):
            if i:
                right = covariance[i - n, :i]
                factor[i, :i] = solve_triangular(factor[:i, :i], right, lower=True, check_finite=False)
            remaining = float(1.0 + self._noise - factor[i, :i] @ factor[i, :i])
            factor[i, i] = np.sqrt(max(remaining, _LEAST_VARIANCE))
            values[i - n] = factor[i, : i + 1] @ self._normals[: i + 1]
        self._factor = factor
        return values
