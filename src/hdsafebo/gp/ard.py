"""Maximum a posteriori length scales, one per dimension, of a Gaussian process on standardised outcomes.

The methods that were published with automatic relevance determination (ARD) fit it here: TuRBO, SCBO and
BAxUS with a Matern-5/2 kernel, constrained expected improvement with the priors that BoTorch sets by
default. The density that is maximised is GPyTorch's, hyper-parameter priors included; its gradient is in
closed form, so a fit takes tens of evaluations of about n^3 + 2 n^2 d operations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import lapack
from scipy.optimize import minimize

from hdsafebo.errors import SurrogateError
from hdsafebo.typing import FloatArray, Shaped

Kernel = Literal["rbf", "matern52"]


@dataclass(frozen=True)
class ArdModel:
    """What is fitted and within which limits; outcomes have mean 0 and variance 1.

    Attributes:
        kernel: family of the covariance.
        length_scale: limits, in units of the inputs (the unit cube).
        noise: limits of the noise variance.
        scale: limits of the signal variance; equal limits fix it.
        dimension_scaled_prior: log-normal priors on length scales, growing as sqrt(d), and on the
            noise (Hvarfner, Hellsten and Nardi, 2024); without, the likelihood alone is maximised.
    """

    kernel: Kernel
    length_scale: tuple[float, float]
    noise: tuple[float, float]
    scale: tuple[float, float]
    dimension_scaled_prior: bool = False


BOTORCH_DEFAULT = ArdModel("rbf", (0.025, np.inf), (1e-4, np.inf), (1.0, 1.0), dimension_scaled_prior=True)
"""`botorch.models.SingleTaskGP` without arguments, as of BoTorch 0.12 and later."""

TRUST_REGION = ArdModel("matern52", (0.005, 4.0), (1e-8, 0.2), (0.05, 20.0))
"""TuRBO's model (Eriksson et al. 2019, supplement): limits as in its code and in BoTorch's tutorial."""


@dataclass(frozen=True)
class ArdFit:
    """Fitted hyper-parameters.

    Attributes:
        length_scales: (d,).
        noise: variance of the noise.
        scale: variance of the signal.
        mean: constant mean.
        log_density: log likelihood plus log prior, per data point, at these values.
    """

    length_scales: Shaped[FloatArray, " d"]
    noise: float
    scale: float
    mean: float
    log_density: float


def fit_ard(
    x: Shaped[FloatArray, "n d"],
    y: Shaped[FloatArray, " n"],
    model: ArdModel,
    start: ArdFit | None = None,
    max_iterations: int = 100,
) -> ArdFit:
    """Hyper-parameters that maximise likelihood times prior; the constant mean in closed form.

    Args:
        x: (n, d) inputs in the unit cube.
        y: (n,) standardised outcomes.
        model: kernel, limits and priors.
        start: earlier fit of the same d to start from; without one, from the mode of the priors.
        max_iterations: of L-BFGS-B.

    Raises:
        SurrogateError: the covariance has no Cholesky factor, not even at the start without an earlier fit.
    """
    d = x.shape[1]
    limits = np.log([*[model.length_scale] * d, model.noise, model.scale])
    result = minimize(
        lambda t: _loss(t, x, y, model)[:2],
        np.clip(_start(model, d, start), limits[:, 0], limits[:, 1]),
        jac=True,
        method="L-BFGS-B",
        bounds=limits,
        options={"maxiter": max_iterations},
    )
    loss, _, mean = _loss(result.x, x, y, model)
    if loss >= _NO_FACTOR:
        if start is not None:
            return fit_ard(x, y, model, None, max_iterations)
        raise SurrogateError(
            f"covariance of {len(x)} points in {d} dimensions has no Cholesky factor at any scale tried"
        )
    values = np.exp(result.x)
    return ArdFit(values[:d], float(values[d]), float(values[d + 1]), mean, -loss)


def correlation(squared_distance: Shaped[FloatArray, " *s"], kernel: Kernel) -> Shaped[FloatArray, " *s"]:
    """Kernel value at scaled squared distances; 1 at distance 0."""
    if kernel == "rbf":
        return np.asarray(np.exp(-0.5 * squared_distance))
    r = np.sqrt(5.0 * squared_distance)
    return np.asarray((1.0 + r + r * r / 3.0) * np.exp(-r))


def _start(model: ArdModel, d: int, start: ArdFit | None) -> Shaped[FloatArray, " e"]:
    """(d + 2,) logarithms to start from: an earlier fit, the prior's mode, or TuRBO's values."""
    if start is not None:
        return np.log([*start.length_scales, start.noise, start.scale])
    if model.dimension_scaled_prior:
        location, spread = _length_scale_prior(d)
        return np.array([*[location - spread**2] * d, _NOISE_LOCATION - 1.0, 0.0])
    return np.log([*[0.5] * d, 5e-3, 1.0])


_NO_FACTOR = 1e10
"""Loss where the covariance cannot be factorised: finite, so that a line search turns back."""

_NOISE_LOCATION = -4.0
"""Location of the log-normal noise prior, whose spread is 1 (Hvarfner et al. 2024)."""


def _length_scale_prior(d: int) -> tuple[float, float]:
    """Location and spread of the log-normal prior of a length scale (Hvarfner et al. 2024)."""
    return float(np.sqrt(2.0) + 0.5 * np.log(d)), float(np.sqrt(3.0))


def _loss(
    theta: Shaped[FloatArray, " e"],
    x: Shaped[FloatArray, "n d"],
    y: Shaped[FloatArray, " n"],
    model: ArdModel,
) -> tuple[float, Shaped[FloatArray, " e"], float]:
    """Negative log density per point, its gradient, the mean; `theta` = log(length scales, noise, scale)."""
    n, d = x.shape
    noise, scale = np.exp(theta[d:])
    a = x / np.exp(theta[:d])
    signal, slope = _covariance(a, scale, model.kernel)
    signal.flat[:: n + 1] += noise
    factor, failed = lapack.dpotrf(signal, lower=1, clean=1)
    if failed:
        return _NO_FACTOR, np.zeros_like(theta), 0.0
    inverse, _ = lapack.dpotri(factor, lower=1)
    inverse = inverse + np.tril(inverse, -1).T
    row_sums = inverse.sum(axis=1)
    mean = float(row_sums @ y / row_sums.sum())
    residual = y - mean
    alpha = inverse @ residual
    value = -0.5 * residual @ alpha - np.log(np.diag(factor)).sum() - 0.5 * n * np.log(2 * np.pi)

    # d log p / d log l_j = 1/2 sum_ab Q_ab dK_ab / d log l_j,  Q = alpha alpha' - K^-1, with the pair sum
    # of (a_aj - a_bj)^2 M_ab expanded into products of matrices.
    q = np.outer(alpha, alpha) - inverse
    m = q * slope
    gradient = np.empty_like(theta)
    gradient[:d] = m.sum(axis=1) @ (a * a) - np.einsum("ij,ij->j", a, m @ a)
    gradient[d] = 0.5 * noise * np.trace(q)
    # y'K^-1 y = tr(Q K) + n with K = signal + noise: what is not noise is the signal's share.
    gradient[d + 1] = 0.5 * (residual @ alpha - n) - gradient[d]
    if model.dimension_scaled_prior:
        location, spread = _length_scale_prior(d)
        z = (theta[:d] - location) / spread
        value += float((-0.5 * z * z - theta[:d] - np.log(spread) - 0.5 * np.log(2 * np.pi)).sum())
        value += float(-0.5 * (theta[d] - _NOISE_LOCATION) ** 2 - theta[d] - 0.5 * np.log(2 * np.pi))
        gradient[:d] += -z / spread - 1.0
        gradient[d] += -(theta[d] - _NOISE_LOCATION) - 1.0
    return float(-value / n), -gradient / n, mean


def _covariance(
    a: Shaped[FloatArray, "n d"], scale: float, kernel: Kernel
) -> tuple[Shaped[FloatArray, "n n"], Shaped[FloatArray, "n n"]]:
    """(n, n) covariance of scaled inputs, and -2 dK/d(r^2), the factor of its length-scale gradient."""
    norms = (a * a).sum(axis=1)
    squared = np.maximum(norms[:, None] + norms - 2.0 * a @ a.T, 0.0)
    np.fill_diagonal(squared, 0.0)
    if kernel == "rbf":
        value = scale * np.exp(-0.5 * squared)
        return value, value.copy()
    r = np.sqrt(5.0 * squared)
    decay = scale * np.exp(-r)
    return (1.0 + r + r * r / 3.0) * decay, (5.0 / 3.0) * (1.0 + r) * decay
