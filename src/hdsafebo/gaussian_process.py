"""One Gaussian process: fit and posterior.

Model: y = c + s * v, v(x) = m + f(x) + noise, f ~ GP(0, q k), noise variance q * ratio, with the isotropic
Matern-5/2 correlation k. c and s standardise the outcomes. Given length scale and noise ratio, the mean m and the
signal variance q that maximise the posterior density are known in closed form (Rasmussen and Williams
2006, sections 2.7 and 5.4.1), so that a fit searches in two dimensions, whatever the number of inputs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import lapack, solve_triangular

from hdsafebo.errors import SurrogateError
from hdsafebo.kernel import exact_distances, fast_distances, matern52, matern52_with_slope
from hdsafebo.problem import FloatArray

_NOISE_MODE = np.log(1e-4)
_NOISE_SPREAD = 2.0
_NOISE_LIMITS = (np.log(1e-7), np.log(1.0))
_LENGTH_SPREAD = 2.0
_FIRST_NOISES = (np.log(1e-4), np.log(1e-2), np.log(0.2))
_GRID = 15
_PSEUDO = 2.0
"""The signal variance has the weight of two more observations of variance one (of the standardised outcomes)."""
_THOROUGH_FITS = 3
_THOROUGH_EVERY = 10
_STEPS = (0.05, 0.5)
_JITTERS = (0.0, 1e-8, 1e-6, 1e-4, 1e-2)
_LEAST_VARIANCE = 1e-10
_OUTLIER = 20.0
_TAIL = 0.05


@dataclass(frozen=True)
class Hyperparameters:
    """Where a fit ended, from which the next one starts.

    Attributes:
        length_scale: in units of the kernel inputs.
        noise_ratio: noise variance over signal variance.
        steps: last step lengths of the search in log length scale and log noise ratio.
        fits: number of fits so far; the first ones, and then every tenth, search a grid.
        reference: median distance of the data of the first fit, which scales prior and limits of the length scale.
        jitters: fits that needed a larger diagonal than the noise.
        fallbacks: fits that failed, so that earlier hyper-parameters were kept.
    """

    length_scale: float
    noise_ratio: float
    steps: tuple[float, float]
    fits: int
    reference: float
    jitters: int = 0
    fallbacks: int = 0


@dataclass(frozen=True)
class LengthScaleLimits:
    """Limits of the fitted length scale in units of the data's median distance."""

    least: float = 0.005
    most: float = 3.0


@dataclass(frozen=True)
class Outcomes:
    """Standardisation of outcomes, with extreme values drawn in.

    Centre is the mean and scale the standard deviation of the central nine tenths of the values, so that one absurd value
    (1e12) does not flatten all others. Beyond 20 scales values grow logarithmically: strictly increasing, so
    that orders and thresholds keep their meaning. Constant outcomes have scale 1.
    """

    centre: float
    scale: float

    @classmethod
    def of(cls, y: FloatArray) -> Outcomes:
        """Standardisation of the (n,) values."""
        tail = int(np.ceil(_TAIL * len(y))) if len(y) > 2 else 0
        central = np.sort(y)[tail : len(y) - tail]
        for values in (central, y):
            centre, scale = float(np.mean(values)), float(np.std(values))
            if scale > 1e-12 * max(abs(centre), 1e-280):
                return cls(centre, scale)
        return cls(float(np.mean(central)), 1.0)

    def standardise(self, y: FloatArray) -> FloatArray:
        """Standardised values."""
        v = (y - self.centre) / self.scale
        far = np.abs(v) > _OUTLIER
        if np.any(far):
            drawn = np.sign(v) * (_OUTLIER + np.log1p(np.abs(v) - _OUTLIER, where=far, out=np.zeros_like(v)))
            v = np.where(far, drawn, v)
        return np.asarray(v)

    def restore(self, v: FloatArray) -> FloatArray:
        """Values in the outcomes' units (drawn-in values stay drawn in)."""
        return self.centre + self.scale * v


@dataclass(frozen=True)
class GaussianProcess:
    """A fitted Gaussian process; means and deviations are in the units of the outcomes.

    Attributes:
        inputs: (n, p) kernel inputs of the data.
        values: (n,) standardised outcomes.
        outcomes: their standardisation.
        hyper: fitted length scale, noise ratio, and where the search stands.
        mean: m, standardised.
        variance: q, standardised.
        factor: (n, n) lower Cholesky factor of k(inputs, inputs) + ratio * 1.
        weights: (n,) solution of (k + ratio * 1) w = values - m.
    """

    inputs: FloatArray
    values: FloatArray
    outcomes: Outcomes
    hyper: Hyperparameters
    mean: float
    variance: float
    factor: FloatArray
    weights: FloatArray

    @property
    def length_scale(self) -> float:
        """Fitted length scale in units of the kernel inputs."""
        return self.hyper.length_scale

    @property
    def signal_deviation(self) -> float:
        """Prior standard deviation, the largest the posterior can have, in the outcomes' units."""
        return float(self.outcomes.scale * np.sqrt(self.variance))

    def correlation(self, x: FloatArray) -> FloatArray:
        """(k, n) prior correlation of the points (k, p) with the data."""
        return matern52(fast_distances(x, self.inputs), self.length_scale)

    def predict_mean(self, x: FloatArray) -> FloatArray:
        """(k,) posterior mean at (k, p) kernel inputs."""
        return self.outcomes.restore(self.mean + self.correlation(x) @ self.weights)

    def predict(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Posterior mean and standard deviation (of the function, without noise), (k,) each, at (k, p) kernel inputs."""
        k = self.correlation(x)
        return self.outcomes.restore(self.mean + k @ self.weights), self.deviation(k)

    def deviation(self, correlation: FloatArray) -> FloatArray:
        """(k,) posterior standard deviation of points whose (k, n) correlation with the data is given."""
        v = solve_triangular(self.factor, correlation.T, lower=True, check_finite=False)
        remaining = np.maximum(1.0 - np.einsum("ij,ij->j", v, v), _LEAST_VARIANCE)
        return self.signal_deviation * np.sqrt(remaining)

    def predict_with_gradient(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Posterior mean, deviation (k,) and their gradients (k, p); meant for few points."""
        k, slope = matern52_with_slope(fast_distances(x, self.inputs), self.length_scale)
        q = k @ self._inverse
        remaining = np.maximum(1.0 - np.einsum("ij,ij->i", q, k), _LEAST_VARIANCE)
        deviation = self.signal_deviation * np.sqrt(remaining)
        mean_gradient = self.outcomes.scale * _pull(slope * self.weights, x, self.inputs)
        variance_gradient = -2.0 * self.signal_deviation**2 * _pull(slope * q, x, self.inputs)
        mean = self.outcomes.restore(self.mean + k @ self.weights)
        return mean, deviation, mean_gradient, variance_gradient / (2.0 * deviation[:, None])

    def covariance(self, x: FloatArray) -> FloatArray:
        """(k, k) posterior covariance; k^3 work, meant for few points."""
        v = solve_triangular(self.factor, self.correlation(x).T, lower=True, check_finite=False)
        prior = matern52(exact_distances(x, x), self.length_scale)
        return self.signal_deviation**2 * (prior - v.T @ v)

    @cached_property
    def _inverse(self) -> FloatArray:
        inverse, _ = lapack.dpotri(self.factor, lower=1)
        return np.asarray(np.tril(inverse) + np.tril(inverse, -1).T)


def _pull(coefficients: FloatArray, x: FloatArray, inputs: FloatArray) -> FloatArray:
    """(k, p) sum over data j of coefficients[:, j] * (x - inputs[j])."""
    return x * coefficients.sum(axis=1)[:, None] - coefficients @ inputs


def fit_gaussian_process(
    inputs: FloatArray,
    distances: FloatArray,
    y: FloatArray,
    *,
    start: Hyperparameters | None = None,
    limits: LengthScaleLimits = LengthScaleLimits(),
) -> GaussianProcess:
    """Fit by maximum a posteriori.

    Log-normal priors keep apart what the data cannot: length scale (median: the data's median distance, spread a
    factor e^2) and noise ratio (1e-4, the same spread).

    Args:
        inputs: (n, p) kernel inputs, n >= 1.
        distances: (n, n) their distances, by `exact_distances`.
        y: (n,) finite outcomes.
        start: hyper-parameters of the last fit of the same function.
        limits: of the length scale.

    Raises:
        SurrogateError: the covariance has no Cholesky factor, not even at the last good hyper-parameters with
            the largest jitter.
    """
    outcomes = Outcomes.of(y)
    search = _Search(
        distances, outcomes.standardise(y), start or _first_guess(distances, inputs.shape[1]), limits
    )
    if start is None:
        for noise in _FIRST_NOISES:
            search.scan(noise)
    elif start.fits < _THOROUGH_FITS or start.fits % _THOROUGH_EVERY == 0:
        search.scan(np.log(start.noise_ratio))
    else:
        search.try_at(np.log(start.length_scale), np.log(start.noise_ratio))
    steps = tuple(search.improve(axis) for axis in (0, 1))
    best = search.best
    if best is None:
        best = search.last_resort()
        steps = search.start.steps
    hyper = replace(
        search.start,
        length_scale=float(np.exp(best.theta[0])),
        noise_ratio=float(np.exp(best.theta[1])),
        steps=steps,  # type: ignore[arg-type]
        fits=search.start.fits + 1,
        jitters=search.start.jitters + (best.jitter > 0),
        fallbacks=search.start.fallbacks + (search.best is None),
    )
    weights = solve_triangular(best.factor, best.residual, lower=True, trans=1, check_finite=False)
    return GaussianProcess(
        inputs, search.values, outcomes, hyper, best.mean, best.variance, best.factor, weights
    )


def _first_guess(distances: FloatArray, dimension: int) -> Hyperparameters:
    """Hyper-parameters to start from without an earlier fit."""
    off_diagonal = distances[np.triu_indices(len(distances), 1)]
    reference = float(np.median(off_diagonal)) if len(off_diagonal) else 0.0
    if not reference > 0:
        reference = float(np.max(distances)) or float(
            np.sqrt(dimension / 6.0)
        )  # of points spread over the unit cube
    return Hyperparameters(reference, float(np.exp(_NOISE_MODE)), (0.35, 1.0), 0, reference)


@dataclass(frozen=True)
class _Evaluation:
    """Posterior density at one theta, and what was computed on the way."""

    theta: tuple[float, float]
    density: float
    mean: float
    variance: float
    factor: FloatArray
    residual: FloatArray
    jitter: float


class _Search:
    """Maximises the profile posterior density over theta = (log length scale, log noise ratio)."""

    def __init__(
        self, distances: FloatArray, values: FloatArray, start: Hyperparameters, limits: LengthScaleLimits
    ) -> None:
        self.distances = distances
        self.values = values
        self.start = start
        self.columns = np.column_stack([values, np.ones(len(values))])
        reference = start.reference
        self.limits = ((np.log(limits.least * reference), np.log(limits.most * reference)), _NOISE_LIMITS)
        self.best: _Evaluation | None = None

    def scan(self, log_noise: float) -> None:
        """Try a grid of length scales."""
        for log_length in np.linspace(*self.limits[0], _GRID):
            self.try_at(float(log_length), log_noise)

    def try_at(self, log_length: float, log_noise: float) -> float:
        """Posterior density at theta, within the limits; the best evaluation is kept."""
        theta = tuple(
            float(np.clip(t, *limits)) for t, limits in zip((log_length, log_noise), self.limits, strict=True)
        )
        found = self._evaluate(theta, 0.0)  # type: ignore[arg-type]
        if found is None:
            return -np.inf
        if self.best is None or found.density > self.best.density:
            self.best = found
        return found.density

    def improve(self, axis: int) -> float:
        """One step along an axis, to the top of the parabola through three points; returns the next step length."""
        step = self.start.steps[axis]
        if self.best is None:
            return step
        centre = self.best.theta
        middle = self.best.density

        def at(offset: float) -> float:
            return self.try_at(*(t + offset * (i == axis) for i, t in enumerate(centre)))

        below, above = at(-step), at(step)
        curvature = below - 2.0 * middle + above
        if np.isfinite(curvature) and curvature < 0:
            at(float(np.clip(0.5 * step * (below - above) / curvature, -2.0 * step, 2.0 * step)))
        return float(np.clip(1.5 * abs(self.best.theta[axis] - centre[axis]), *_STEPS))

    def last_resort(self) -> _Evaluation:
        """The last good hyper-parameters, with as much jitter as it takes."""
        theta = (float(np.log(self.start.length_scale)), float(np.log(self.start.noise_ratio)))
        for jitter in _JITTERS:
            found = self._evaluate(theta, jitter)
            if found is not None:
                return found
        raise SurrogateError(
            f"covariance of {len(self.values)} points has no Cholesky factor at length scale {self.start.length_scale:.3g} "
            f"and noise ratio {self.start.noise_ratio:.3g}, not even with jitter {_JITTERS[-1]:g}"
        )

    def _evaluate(self, theta: tuple[float, float], jitter: float) -> _Evaluation | None:
        n = len(self.values)
        covariance = matern52(self.distances, np.exp(theta[0]))
        covariance.flat[:: n + 1] = 1.0 + np.exp(theta[1]) + jitter
        # The transpose of the symmetric matrix is in LAPACK's own memory order: no copy is made.
        factor, failed = lapack.dpotrf(covariance.T, lower=1, clean=1, overwrite_a=1)
        if failed:
            return None
        half = solve_triangular(factor, self.columns, lower=True, check_finite=False)
        mean = float(half[:, 0] @ half[:, 1] / (half[:, 1] @ half[:, 1]))
        residual = half[:, 0] - mean * half[:, 1]
        variance = float((residual @ residual + _PSEUDO) / (n + _PSEUDO))
        density = -0.5 * (n + _PSEUDO) * np.log(variance) - np.log(np.diag(factor)).sum()
        density -= 0.5 * ((theta[0] - np.log(self.start.reference)) / _LENGTH_SPREAD) ** 2
        density -= 0.5 * ((theta[1] - _NOISE_MODE) / _NOISE_SPREAD) ** 2
        if not np.isfinite(density):
            return None
        return _Evaluation(theta, float(density), mean, variance, factor, residual, jitter)
