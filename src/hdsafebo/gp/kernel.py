"""The isotropic Matern-5/2 kernel: values, gradients and spectral samples.

With r the distance and l the length scale, k(r) = (1 + a + a^2 / 3) exp(-a), a = sqrt(5) r / l
(Rasmussen and Williams 2006, equation 4.17). It is stationary and isotropic, which is what carries a
bound over from a latent space to the original one (paper, Proposition 3).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

from hdsafebo.typing import FloatArray, Shaped

_SQRT5 = np.sqrt(5.0)
_FARTHEST = 800.0
"""Scaled distances are cut here: exp(-800) is 0, and the cut keeps infinity * 0 out."""


def exact_distances(a: Shaped[FloatArray, "n p"], b: Shaped[FloatArray, "m p"]) -> Shaped[FloatArray, "n m"]:
    """(n, m) Euclidean distances, each computed from its own pair alone.

    An entry does not depend on which other rows are present, so that a matrix grown row by row equals one
    computed at once to the bit.
    """
    return np.asarray(cdist(a, b))


def fast_distances(a: Shaped[FloatArray, "n p"], b: Shaped[FloatArray, "m p"]) -> Shaped[FloatArray, "n m"]:
    """(n, m) Euclidean distances by one matrix product; absolute error about 1e-8 times the norms."""
    squared = a @ b.T
    squared *= -2.0
    squared += np.einsum("ij,ij->i", a, a)[:, None]
    squared += np.einsum("ij,ij->i", b, b)
    np.maximum(squared, 0.0, out=squared)
    return np.sqrt(squared, out=squared)


def matern52(distance: Shaped[FloatArray, " *s"], length_scale: float) -> Shaped[FloatArray, " *s"]:
    """Correlation at the given distances; 1 at distance 0."""
    a = distance * (_SQRT5 / length_scale)
    np.minimum(a, _FARTHEST, out=a)
    decay = np.exp(-a)
    value = a * (1.0 / 3.0)
    value += 1.0
    value *= a
    value += 1.0
    value *= decay
    return value


def matern52_with_slope(
    distance: Shaped[FloatArray, " *s"], length_scale: float
) -> tuple[Shaped[FloatArray, " *s"], Shaped[FloatArray, " *s"]]:
    """Correlation k, and s such that the gradient in the first argument is s * (x - x')."""
    a = np.minimum(distance * (_SQRT5 / length_scale), _FARTHEST)
    decay = np.exp(-a)
    return (1.0 + a + a * a / 3.0) * decay, -(5.0 / (3.0 * length_scale**2)) * (1.0 + a) * decay


def spectral_frequencies(
    n: int, dimension: int, length_scale: float, rng: np.random.Generator
) -> Shaped[FloatArray, "n d"]:
    """(n, d) frequencies from the kernel's spectral density, a Student t with 5 degrees of freedom."""
    normal = rng.standard_normal((n, dimension))
    return normal * (np.sqrt(5.0 / rng.chisquare(5.0, n))[:, None] / length_scale)
