"""Fit of one Gaussian process by maximum a posteriori.

Given length scale and noise ratio, the mean m and the signal variance q that maximise the posterior density
are known in closed form (Rasmussen and Williams 2006, sections 2.7 and 5.4.1), so a fit searches in two
dimensions. It starts where the last one ended.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import lapack, solve_triangular

from hdsafebo.errors import SurrogateError
from hdsafebo.gp.gaussian_process import GaussianProcess, Hyperparameters
from hdsafebo.gp.kernel import matern52
from hdsafebo.gp.outcomes import Outcomes
from hdsafebo.typing import FloatArray, Shaped

_LENGTH_SPREAD = 2.0
"""Standard deviation of the log length scale: wide, so that a few dozen trials outweigh it."""
_FIRST_STEPS = (0.35, 1.0)
"""Of the first parabola in log length scale and log noise ratio: about half a step of the grid."""
_STEPS = (0.05, 0.5)
"""Limits of later steps: small enough to settle, never so small that the parabola is rounding."""
_LENGTH_LIMITS = (0.005, 3.0)
"""Of the length scale, in median distances of the data: from too short for any data to nearly a constant."""
_GRID = 15
"""Length scales of a scan: over limits of a factor of 600, neighbours differ by a factor of 1.6."""
_THOROUGH_FITS = 3
_THOROUGH_EVERY = 10
"""The first fits and every tenth scan: few trials leave several maxima, and a warm start stays in its own."""
_PSEUDO = 2.0
"""The signal variance is drawn to one (of standardised outcomes) with the weight of two observations."""
_SIGNAL_VARIANCES = (1e-4, 1.0, 0.3, 0.03, 100.0)
"""Of standardised outcomes with known noise: the least, three to begin with, the largest."""
_JITTERS = (0.0, 1e-8, 1e-6, 1e-4, 1e-2)
"""Tried in this order, so that the diagonal grows by no more than the factorisation needs."""


@dataclass(frozen=True)
class NoisePrior:
    """Log-normal prior of the noise ratio, noise variance over signal variance.

    Attributes:
        mode: the likeliest ratio.
        spread: standard deviation of its logarithm.
        least: smallest ratio.
        most: largest one.
        first: ratios at which a first fit tries all length scales.
    """

    mode: float = 1e-4
    spread: float = 2.0
    least: float = 1e-7
    most: float = 1.0
    first: tuple[float, ...] = (1e-4, 1e-2, 0.2)


@dataclass(frozen=True)
class KnownNoise:
    """Noise of standardised outcomes that is known.

    Attributes:
        variance: mean over the data.
        relative: (n,) variances of the data over their mean.
    """

    variance: float
    relative: Shaped[FloatArray, " n"]

    @classmethod
    def of(cls, deviations: Shaped[FloatArray, " n"]) -> KnownNoise:
        """From (n,) standard deviations of the standardised outcomes."""
        variances = deviations**2
        mean = float(variances.mean())
        return cls(mean, variances / mean)

    def prior(self) -> NoisePrior:
        """The ratios that leave the signal a likely variance, all of them equally likely beforehand."""
        ratios = [self.variance / q for q in _SIGNAL_VARIANCES]
        return NoisePrior(ratios[1], np.inf, ratios[-1], ratios[0], tuple(ratios[1:-1]))


def fit_gaussian_process(
    inputs: Shaped[FloatArray, "n p"],
    distances: Shaped[FloatArray, "n n"],
    y: Shaped[FloatArray, " n"],
    *,
    start: Hyperparameters | None = None,
    noise: NoisePrior | None = None,
    known_noise: Shaped[FloatArray, " n"] | None = None,
    refine: bool = True,
) -> GaussianProcess:
    """Fit by maximum a posteriori.

    Log-normal priors keep apart what the data cannot: length scale (median: the data's median distance,
    spread a factor e^2) and noise ratio (see `NoisePrior`).

    Args:
        inputs: (n, p) kernel inputs, n >= 1.
        distances: (n, n) their distances, by `exact_distances`.
        y: (n,) finite outcomes.
        start: hyper-parameters of the last fit of the same function.
        noise: prior of the noise ratio.
        known_noise: (n,) standard deviations of the outcomes, where they are known; in place of a noise
            ratio the signal variance is then searched.
        refine: False keeps length scale and noise ratio of `start`, if there is one.

    Raises:
        SurrogateError: the covariance has no Cholesky factor, not even at the last good hyper-parameters with
            the largest jitter.
    """
    outcomes = Outcomes.of(y)
    known = None if known_noise is None else KnownNoise.of(known_noise / outcomes.scale)
    noise = noise or NoisePrior()
    noise = noise if known is None else known.prior()
    search = _Search(
        distances,
        outcomes.standardise(y),
        start or _first_guess(distances, inputs.shape[1], noise),
        noise,
        known,
    )
    refine = refine or start is None
    if start is None:
        for ratio in noise.first:
            search.scan(np.log(ratio))
    elif refine and (start.fits < _THOROUGH_FITS or start.fits % _THOROUGH_EVERY == 0):
        search.scan(np.log(start.noise_ratio))
    else:
        search.try_at(np.log(start.length_scale), np.log(start.noise_ratio))
    # Axis by axis: the two are nearly independent near the maximum, and the next fit goes on from here.
    steps = tuple(search.improve(axis) for axis in (0, 1)) if refine else search.start.steps
    best = search.best
    if best is None:
        best = search.last_resort()
        steps = search.start.steps
    hyper = replace(
        search.start,
        length_scale=float(np.exp(best.theta[0])),
        noise_ratio=float(np.exp(best.theta[1])),
        steps=steps,  # type: ignore[arg-type]
        fits=search.start.fits + refine,
        jitters=search.start.jitters + (best.jitter > 0),
        fallbacks=search.start.fallbacks + (search.best is None),
    )
    weights = solve_triangular(best.factor, best.residual, lower=True, trans=1, check_finite=False)
    return GaussianProcess(
        inputs,
        search.values,
        outcomes,
        hyper,
        best.mean,
        best.variance,
        best.factor,
        weights,
        None if known is None else known.relative,
    )


def _first_guess(distances: Shaped[FloatArray, "n n"], dimension: int, noise: NoisePrior) -> Hyperparameters:
    """Hyper-parameters to start from without an earlier fit."""
    off_diagonal = distances[np.triu_indices(len(distances), 1)]
    reference = float(np.median(off_diagonal)) if len(off_diagonal) else 0.0
    if not reference > 0:
        reference = float(np.max(distances)) or float(
            np.sqrt(dimension / 6.0)
        )  # of points spread over the unit cube
    return Hyperparameters(reference, noise.mode, _FIRST_STEPS, 0, reference)


@dataclass(frozen=True)
class _Evaluation:
    """Posterior density at one theta, and what was computed on the way."""

    theta: tuple[float, float]
    density: float
    mean: float
    variance: float
    factor: Shaped[FloatArray, "n n"]
    residual: Shaped[FloatArray, " n"]
    jitter: float


class _Search:
    """Maximises the profile posterior density over theta = (log length scale, log noise ratio)."""

    def __init__(
        self,
        distances: Shaped[FloatArray, "n n"],
        values: Shaped[FloatArray, " n"],
        start: Hyperparameters,
        noise: NoisePrior,
        known: KnownNoise | None,
    ) -> None:
        self.known = known
        self.distances = distances
        self.values = values
        self.start = start
        self.noise = noise
        self.columns = np.column_stack([values, np.ones(len(values))])
        reference = start.reference
        self.limits = (
            (np.log(_LENGTH_LIMITS[0] * reference), np.log(_LENGTH_LIMITS[1] * reference)),
            (np.log(noise.least), np.log(noise.most)),
        )
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
        """Step along an axis to the top of the parabola through three points; returns the next step."""
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
            f"covariance of {len(self.values)} points has no Cholesky factor at length scale "
            f"{self.start.length_scale:.3g} and noise ratio {self.start.noise_ratio:.3g}, "
            f"not even with jitter {_JITTERS[-1]:g}"
        )

    def _evaluate(self, theta: tuple[float, float], jitter: float) -> _Evaluation | None:
        n = len(self.values)
        covariance = matern52(self.distances, np.exp(theta[0]))
        relative = 1.0 if self.known is None else self.known.relative
        covariance.flat[:: n + 1] = 1.0 + np.exp(theta[1]) * relative + jitter
        # The transpose of the symmetric matrix is in LAPACK's own memory order: no copy is made.
        factor, failed = lapack.dpotrf(covariance.T, lower=1, clean=1, overwrite_a=1)
        if failed:
            return None
        half = solve_triangular(factor, self.columns, lower=True, check_finite=False)
        # With L^-1 y and L^-1 1 at hand, mean (generalised least squares) and variance are closed forms.
        mean = float(half[:, 0] @ half[:, 1] / (half[:, 1] @ half[:, 1]))
        residual = half[:, 0] - mean * half[:, 1]
        squares = float(residual @ residual + _PSEUDO)
        variance = squares / (n + _PSEUDO) if self.known is None else self.known.variance / np.exp(theta[1])
        density = -0.5 * (n + _PSEUDO) * np.log(variance) - np.log(np.diag(factor)).sum()
        if (
            self.known is not None
        ):  # otherwise the variance that maximises the density, and this is a constant
            density -= 0.5 * squares / variance
        # Log-normal priors keep apart what few data cannot: a long scale with noise, a short one without.
        density -= 0.5 * ((theta[0] - np.log(self.start.reference)) / _LENGTH_SPREAD) ** 2
        density -= 0.5 * ((theta[1] - np.log(self.noise.mode)) / self.noise.spread) ** 2
        if not np.isfinite(density):
            return None
        return _Evaluation(theta, float(density), mean, variance, factor, residual, jitter)
