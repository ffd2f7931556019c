"""Fit of a process with a length scale per input to warped outcomes, by maximum a posteriori.

Given length scales and noise ratio, mean and signal variance are known in closed form (Rasmussen and Williams
2006, sections 2.7 and 5.4.1); L-BFGS-B searches the rest with analytic gradients from where the last fit
ended. Which warp is used is chosen by the density of the outcomes themselves; at given length scales all
warps share one Cholesky factor, so asking which of them is best costs hardly more than one evaluation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import lapack
from scipy.optimize import minimize

from hdsafebo.errors import SurrogateError
from hdsafebo.gp.warp import Warp
from hdsafebo.typing import FloatArray

LENGTH_LIMITS = (0.005, 20.0)
"""Of a length scale, in sides of the unit cube: from one that no data can show to one that is a constant."""
_LENGTH_MEDIAN = 0.5
"""Times sqrt(d): the prior's median, near the typical distance of two points of the cube, 0.41 sqrt(d)."""
_LENGTH_SPREAD = 1.0
"""Standard deviation of the mean log length scale."""
_DIFFERENCE = 0.1
"""Scale of the Cauchy prior of each log length scale's distance from their mean: equal unless data insist."""
_NOISE_MODE, _NOISE_SPREAD = 1e-6, 2.0
"""Log-normal prior of the noise ratio: most functions that are computed have none."""
_NOISE_LIMITS = (1e-8, 1.0)
_WARP_PRICE = 2.0
"""Nats that a warp must gain on the values as they are."""
_PSEUDO = 2.0
"""The signal variance is drawn to that of the warped outcomes with the weight of two observations."""
_WARM_ITERATIONS, _THOROUGH_ITERATIONS = 5, 20
_GROWTH, _THOROUGH_GROWTH = 1.05, 1.5
"""Factors by which the data have grown before hyper-parameters are searched again, and thoroughly."""
_TRIED = 2
"""Warps beside none that a thorough fit searches length scales for."""
JITTERS = (0.0, 1e-8, 1e-6, 1e-4, 1e-2)


@dataclass(frozen=True)
class WarpedFit:
    """Where a fit ended, from which the next one starts.

    Attributes:
        log_length_scales: (d,).
        log_noise: of the noise ratio, noise variance over signal variance.
        warp_scale: of the chosen warp.
        warp_scales: those that may be chosen, fixed by the first data.
        fitted_at, thorough_at: number of data of the last search, and of the last thorough one.
        fits: number of fits so far.
        jitters: fits that needed a larger diagonal than the noise.
        fallbacks: fits whose covariance had no factor, so that earlier values were kept.
    """

    log_length_scales: tuple[float, ...]
    log_noise: float
    warp_scale: float
    warp_scales: tuple[float, ...]
    fitted_at: int = 0
    thorough_at: int = 0
    fits: int = 0
    jitters: int = 0
    fallbacks: int = 0

    @property
    def theta(self) -> FloatArray:
        """(d + 1,) log length scales and log noise ratio."""
        return np.array([*self.log_length_scales, self.log_noise])


@dataclass(frozen=True)
class Standard:
    """Outcomes as they are modelled: warped, then standardised.

    Attributes:
        warp: applied first.
        shift, unit: then subtracted, and divided by.
    """

    warp: Warp
    shift: float
    unit: float

    @classmethod
    def of(cls, y: FloatArray, warp: Warp) -> Standard:
        """Standardisation of the (n,) outcomes; constant ones have unit 1."""
        t = warp.apply(y)
        shift, unit = float(t.mean()), float(t.std())
        return cls(warp, shift, unit if unit > 1e-12 * max(abs(shift), 1e-280) else 1.0)

    def apply(self, y: FloatArray) -> FloatArray:
        """Outcomes as modelled."""
        return np.asarray((self.warp.apply(y) - self.shift) / self.unit)

    def restore(self, t: FloatArray) -> FloatArray:
        """Inverse of `apply`."""
        return self.warp.restore(self.shift + self.unit * t)

    def log_jacobian(self, y: FloatArray) -> float:
        """Logarithm of the derivative of `apply`, summed over the (n,) outcomes."""
        return self.warp.log_jacobian(y) - len(y) * float(np.log(self.unit))

    def variance(self, y: FloatArray, deviation: FloatArray) -> float:
        """Median variance, as modelled, of (n,) outcomes with (n,) small deviations; NaN is left out."""
        known = np.isfinite(deviation)
        if not known.any():
            return 0.0
        slope = np.exp([self.warp.log_jacobian(y[[i]]) for i in np.flatnonzero(known)]) / self.unit
        return float(np.median((deviation[known] * slope) ** 2))


def correlation(squared: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Matern-5/2 at squared distances in length scales, and s: its gradient in x is -s (x - x')."""
    r = np.sqrt(5.0 * squared)
    decay = np.exp(-r)
    slope = (1.0 + r) * decay
    value = slope + (5.0 / 3.0) * squared * decay
    slope *= 5.0 / 3.0
    return value, slope


def squared_distances(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, k) squared distances between the rows of (n, d) and (k, d)."""
    squared = a @ b.T
    squared *= -2.0
    squared += np.einsum("ij,ij->i", a, a)[:, None]
    squared += np.einsum("ij,ij->i", b, b)
    return np.maximum(squared, 0.0, out=squared)


def fit_warped(
    x: FloatArray,
    y: FloatArray,
    centre: float,
    start: WarpedFit,
    noise: FloatArray | None = None,
    least_noise: float = 0.0,
) -> tuple[WarpedFit, Standard]:
    """Length scales, noise ratio and warp of greatest posterior density.

    Args:
        x: (n, d) points of the unit cube, n >= 1.
        y: (n,) finite outcomes.
        centre: of the warp.
        start: of the last fit; see `first_fit`.
        noise: (n,) known standard deviations of the outcomes, NaN where unknown; the noise ratio is not less
            than their median says.
        least_noise: least noise ratio, where outcomes are more rugged than a process can be.
    """
    if start.fits and len(y) < _GROWTH * start.fitted_at:
        scale = start.warp_scale
        return replace(start, fits=start.fits + 1), Standard.of(y, Warp(centre, scale))
    thorough = start.fits == 0 or len(y) >= _THOROUGH_GROWTH * start.thorough_at
    known = np.full(len(y), np.nan) if noise is None else noise
    search = _Search(x, y, centre, start, known, least_noise)
    begin = start.theta
    order = search.warps_by_density(begin)
    tried = order[: _TRIED if thorough else 1]
    if thorough and np.inf not in tried:
        tried = [*tried, np.inf]
    for scale in tried:
        search.improve(scale, begin, _THOROUGH_ITERATIONS if thorough else _WARM_ITERATIONS)
    if thorough and start.fits:  # from elsewhere, lest the fit follows one optimum only
        search.improve(search.best_scale, first_fit(x.shape[1], ()).theta, _THOROUGH_ITERATIONS)
    theta, scale = search.best_theta, search.best_scale
    fit = WarpedFit(
        tuple(float(v) for v in theta[:-1]),
        float(theta[-1]),
        scale,
        start.warp_scales,
        len(y),
        len(y) if thorough else start.thorough_at,
        start.fits + 1,
        start.jitters,
        start.fallbacks + (not np.isfinite(search.best_density)),
    )
    return fit, Standard.of(y, Warp(centre, scale))


def first_fit(dimension: int, warp_scales: tuple[float, ...]) -> WarpedFit:
    """Where a fit starts that has no earlier one: at the mode of the prior, without a warp."""
    length = float(np.clip(np.log(_LENGTH_MEDIAN * np.sqrt(dimension)), *np.log(LENGTH_LIMITS)))
    return WarpedFit((length,) * dimension, float(np.log(_NOISE_MODE)), np.inf, warp_scales)


class _Search:
    """Maximises the posterior density over length scales, noise ratio and warps."""

    def __init__(
        self,
        x: FloatArray,
        y: FloatArray,
        centre: float,
        start: WarpedFit,
        noise: FloatArray,
        least_noise: float,
    ) -> None:
        self.x = x
        self.standards = {
            scale: Standard.of(y, Warp(centre, scale)) for scale in (np.inf, *start.warp_scales)
        }
        self.targets = {scale: standard.apply(y) for scale, standard in self.standards.items()}
        self.worth = {
            scale: standard.log_jacobian(y) - (0.0 if np.isinf(scale) else _WARP_PRICE)
            for scale, standard in self.standards.items()
        }
        self.least_noise = {
            scale: max(np.clip(standard.variance(y, noise), *_NOISE_LIMITS), least_noise)
            for scale, standard in self.standards.items()
        }
        self.bounds = [tuple(np.log(LENGTH_LIMITS))] * x.shape[1]
        self.best_density = -np.inf
        self.best_theta, self.best_scale = start.theta, start.warp_scale
        if start.warp_scale not in self.standards:
            self.best_scale = np.inf

    def warps_by_density(self, theta: FloatArray) -> list[float]:
        """Scales of all warps, the likeliest first, at given length scales and noise."""
        n = len(self.x)
        factor = _factor(self.x / np.exp(theta[:-1]), np.exp(theta[-1]))
        scales = list(self.standards)
        if factor is None:
            return scales
        columns = np.column_stack([self.targets[scale] for scale in scales] + [np.ones(n)])
        half, _ = lapack.dtrtrs(factor, columns, lower=1)
        ones = half[:, -1]
        mean = ones @ half[:, :-1] / (ones @ ones)
        residual = half[:, :-1] - mean * ones[:, None]
        variance = (np.einsum("ij,ij->j", residual, residual) + _PSEUDO) / (n + _PSEUDO)
        density = -0.5 * (n + _PSEUDO) * np.log(variance) + [self.worth[scale] for scale in scales]
        return [scales[i] for i in np.argsort(-density, kind="stable")]

    def improve(self, scale: float, begin: FloatArray, iterations: int) -> None:
        """Climb from `begin` under one warp; the best end of all climbs is kept."""
        target = self.targets[scale]
        bounds = [*self.bounds, (np.log(self.least_noise[scale]), np.log(_NOISE_LIMITS[1]))]
        begin = np.clip(begin, *np.array(bounds).T)
        found = minimize(
            _loss, begin, (self.x, target), jac=True, method="L-BFGS-B", bounds=bounds,
            options={"maxiter": iterations},
        )  # fmt: skip
        density = -float(found.fun) + self.worth[scale]
        if found.fun < _NO_FACTOR and density > self.best_density:
            self.best_density, self.best_theta, self.best_scale = density, found.x, scale


_NO_FACTOR = 1e10
"""Loss where the covariance cannot be factorised."""


def _factor(scaled: FloatArray, noise: float, jitter: float = 0.0) -> FloatArray | None:
    """Lower Cholesky factor of the correlation of (n, d) scaled points, plus noise; None if it fails."""
    n = len(scaled)
    squared = squared_distances(scaled, scaled)
    squared.flat[:: n + 1] = 0.0
    k, _ = correlation(squared)
    k.flat[:: n + 1] = 1.0 + noise + jitter
    factor, failed = lapack.dpotrf(k, lower=1, clean=1)
    return None if failed else factor


def factor_with_jitter(scaled: FloatArray, noise: float) -> tuple[FloatArray, float]:
    """The factor with as little jitter as it takes, and the jitter.

    Raises:
        SurrogateError: no jitter is large enough.
    """
    for jitter in JITTERS:
        factor = _factor(scaled, noise, jitter)
        if factor is not None:
            return factor, jitter
    raise SurrogateError(
        f"covariance of {len(scaled)} points has no Cholesky factor, not even with jitter {JITTERS[-1]:g}"
    )


def profile(inverse: FloatArray, target: FloatArray) -> tuple[float, float, FloatArray]:
    """Mean and signal variance of greatest density, and the weights of the data in the posterior mean.

    Args:
        inverse: (n, n) of the correlation with noise.
        target: (n,) standardised outcomes.
    """
    rows = inverse.sum(axis=1)
    mean = float(rows @ target / rows.sum())
    residual = target - mean
    weights = inverse @ residual
    return mean, float((residual @ weights + _PSEUDO) / (len(target) + _PSEUDO)), weights


def symmetric_inverse(factor: FloatArray) -> FloatArray:
    """(n, n) inverse of the matrix whose lower factor is given, zeros above it."""
    lower, _ = lapack.dpotri(factor, lower=1)  # above its diagonal are the zeros of the factor
    inverse = lower + lower.T
    inverse.flat[:: len(inverse) + 1] *= 0.5
    return np.asarray(inverse)


def _loss(theta: FloatArray, x: FloatArray, target: FloatArray) -> tuple[float, FloatArray]:
    """Negative log posterior density of (d + 1,) log length scales and log noise ratio, and its gradient."""
    n = len(target)
    noise = float(np.exp(theta[-1]))
    scaled = x / np.exp(theta[:-1])
    squared = squared_distances(scaled, scaled)
    squared.flat[:: n + 1] = 0.0
    k, slope = correlation(squared)
    k.flat[:: n + 1] = 1.0 + noise
    factor, failed = lapack.dpotrf(k, lower=1, clean=1)
    if failed:
        return _NO_FACTOR, np.zeros_like(theta)
    inverse = symmetric_inverse(factor)
    _, variance, weights = profile(inverse, target)
    density = -0.5 * (n + _PSEUDO) * np.log(variance) - np.log(np.diag(factor)).sum()
    penalty, by_length, by_noise = _prior(theta)
    outer = np.outer(weights, weights) / variance - inverse
    weighted = outer * slope
    by_theta = np.append(
        weighted.sum(axis=1) @ (scaled * scaled) - np.einsum("ij,ij->j", scaled, weighted @ scaled),
        0.5 * noise * np.trace(outer),
    )
    return penalty - float(density), np.append(by_length, by_noise) - by_theta


def _prior(theta: FloatArray) -> tuple[float, FloatArray, float]:
    """Negative log prior, and its gradient in log length scales and in the log noise ratio."""
    d = len(theta) - 1
    offset = theta[:-1] - np.log(_LENGTH_MEDIAN * np.sqrt(d))
    centre = offset.mean()
    apart = (offset - centre) / _DIFFERENCE
    pull = 2.0 * apart / (1.0 + apart * apart) / _DIFFERENCE
    noisy = (theta[-1] - np.log(_NOISE_MODE)) / _NOISE_SPREAD
    penalty = 0.5 * (centre / _LENGTH_SPREAD) ** 2 + np.log1p(apart * apart).sum() + 0.5 * noisy * noisy
    by_length = centre / _LENGTH_SPREAD**2 / d + pull - pull.mean()
    return float(penalty), by_length, float(noisy / _NOISE_SPREAD)
