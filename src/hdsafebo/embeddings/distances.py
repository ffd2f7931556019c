"""Measures of how two spaces differ in their distances, and what that does to a Gaussian process."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from hdsafebo.embeddings.base import Embedding
from hdsafebo.errors import DatasetError
from hdsafebo.gp.kernel import exact_distances, matern52
from hdsafebo.typing import FloatArray

Rows = NDArray[np.intp]

NOISE_VARIANCE = 1e-2  # of the Gaussian process comparison, relative to the prior variance
PAIR_CHUNK = 4096
JACOBIAN_STEP = 1e-5  # relative to the codes' root mean square; central differences in double precision


def sample_pairs(points: int, count: int, rng: np.random.Generator) -> Rows:
    """`count` random pairs of two different points out of `points`, shape (2, count)."""
    if points < 2:
        raise DatasetError(f"distances need at least 2 points, got {points}")
    first = rng.integers(points, size=count)
    return np.stack([first, (first + rng.integers(1, points, size=count)) % points])


def pair_distances(x: FloatArray, pairs: Rows) -> FloatArray:
    """Euclidean distances (p,) of the pairs (2, p) of points (n, k)."""
    blocks = [pairs[:, start : start + PAIR_CHUNK] for start in range(0, pairs.shape[1], PAIR_CHUNK)]
    return np.concatenate([np.linalg.norm(x[a] - x[b], axis=1) for a, b in blocks])


def distance_correlation(original: FloatArray, latent: FloatArray) -> float:
    """Pearson correlation of distances (p,) in the two spaces; 0 if one of them does not vary."""
    if min(np.ptp(original), np.ptp(latent)) == 0:
        return 0.0
    return float(np.corrcoef(original, latent)[0, 1])


def distance_scale(original: FloatArray, latent: FloatArray) -> float:
    """s that minimises the squared error of latent = s * original."""
    return float(original @ latent / (original @ original))


def gp_differences(
    x: FloatArray, z: FloatArray, scale: float, rng: np.random.Generator, *, train: int, draws: int
) -> tuple[float, float]:
    """Difference between the Gaussian process posteriors in the original and in the latent space.

    A Matern-5/2 prior of variance 1 whose length scale is the median distance of the points in the
    original space, and `scale` times that in the latent one (an isometry up to that scale gives 0). Both
    posteriors see the same noisy values (variance 0.01) at the first `train` points, drawn from the prior
    in the original space, and are compared at the other points:

        mean difference     = average of |mu_X - mu_Z|            over points and draws,
        variance difference = average of |sigma_X^2 - sigma_Z^2|  over points.

    The paper prints such differences without their definition, so only their order compares with ours.

    Args:
        x: points, shape (n, D).
        z: their codes, shape (n, d).
        scale: of latent over original distances.
        rng: draws the functions and the noise.
        train: points that are observed, less than n.
        draws: functions.

    Returns:
        Mean difference in prior standard deviations, variance difference in prior variances.
    """
    original, latent = exact_distances(x, x), exact_distances(z, z)
    length = float(np.median(original[np.triu_indices(len(x), 1)]))
    k_x, k_z = matern52(original, length), matern52(latent, max(scale * length, np.finfo(float).tiny))
    factor = np.linalg.cholesky(k_x + NOISE_VARIANCE * np.eye(len(x)))
    y = (factor @ rng.standard_normal((len(x), draws)))[:train]
    (mean_x, variance_x), (mean_z, variance_z) = (_posterior(k, y) for k in (k_x, k_z))
    return float(np.abs(mean_x - mean_z).mean()), float(np.abs(variance_x - variance_z).mean())


def condition_number(embedding: Embedding, z: FloatArray) -> float:
    """Median condition number of the decoder's pullback metric J'J at codes (n, d); inf without full rank."""
    singular = np.linalg.svd(decoder_jacobian(embedding, z), compute_uv=False)
    smallest, largest = singular[:, -1], singular[:, 0]
    ratio = np.divide(largest, smallest, out=np.full_like(largest, np.inf), where=smallest > 0)
    return float(np.median(ratio) ** 2)


def decoder_jacobian(embedding: Embedding, z: FloatArray) -> FloatArray:
    """Jacobian of the decoder at codes (n, d) by central differences, shape (n, D, d)."""
    step = JACOBIAN_STEP * float(np.sqrt(np.mean(z**2)) or 1.0)
    differences = [embedding.decode(z + s) - embedding.decode(z - s) for s in step * np.eye(z.shape[1])]
    return np.stack(differences, axis=-1) / (2 * step)


def reconstruction_mse(embedding: Embedding, x: FloatArray) -> float:
    """Mean squared error per component of decoded codes of points (n, D)."""
    return float(np.mean((embedding.decode(embedding.encode(x)) - x) ** 2))


def _posterior(k: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean (m, draws) and variance (m,) at the points after the first len(y), given those."""
    train = len(y)
    factor = cho_factor(k[:train, :train] + NOISE_VARIANCE * np.eye(train), lower=True)
    cross = k[:train, train:]
    weights = cho_solve(factor, cross)
    return weights.T @ y, np.diag(k)[train:] - np.einsum("ij,ij->j", cross, weights)
