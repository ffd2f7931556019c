"""The posterior of one Gaussian process.

Model: y = c + s * v, v(x) = m + f(x) + noise, f ~ GP(0, q k), noise variance q * ratio, with the isotropic
Matern-5/2 correlation k; c and s standardise the outcomes. `gp_fit` finds the hyper-parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import lapack, solve_triangular

from hdsafebo.gp.kernel import exact_distances, fast_distances, matern52, matern52_with_slope
from hdsafebo.gp.outcomes import Outcomes
from hdsafebo.typing import FloatArray, Shaped

_LEAST_VARIANCE = 1e-10
"""Of the prior's: what rounding leaves of 1 - k' K^-1 k at a point of the data."""
_FAST_ERROR = 3e-8
"""Largest error of `fast_distances`, over the norms: the square root of a few units of rounding."""
_TOLERATED_ERROR = 1e-3
"""In length scales; larger errors would change variances near the data by more than the noise."""


@dataclass(frozen=True)
class Hyperparameters:
    """Where a fit ended, from which the next one starts.

    Attributes:
        length_scale: in units of the kernel inputs.
        noise_ratio: noise variance over signal variance.
        steps: last step lengths of the search in log length scale and log noise ratio.
        fits: number of fits so far; the first ones, and then every tenth, search a grid.
        reference: median distance of the data of the first fit; it scales prior and limits of length scales.
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
        relative_noise: (n,) noise variances of the data over their mean, where they are known and may differ;
            `ratio` is then that of the mean, times this on the diagonal.
        predicted_noise: variance of one measurement over the signal variance, added to predicted variances
            when predictions are of what will be measured; 0 when they are of the function.
    """

    inputs: Shaped[FloatArray, "n p"]
    values: Shaped[FloatArray, " n"]
    outcomes: Outcomes
    hyper: Hyperparameters
    mean: float
    variance: float
    factor: Shaped[FloatArray, "n n"]
    weights: Shaped[FloatArray, " n"]
    relative_noise: Shaped[FloatArray, " n"] | None = None
    predicted_noise: float = 0.0

    @property
    def noise_ratios(self) -> Shaped[FloatArray, " n"]:
        """(n,) noise variance of each datum over the signal variance."""
        relative = np.ones(len(self.values)) if self.relative_noise is None else self.relative_noise
        return self.hyper.noise_ratio * relative

    @property
    def length_scale(self) -> float:
        """Fitted length scale in units of the kernel inputs."""
        return self.hyper.length_scale

    @property
    def signal_deviation(self) -> float:
        """Prior standard deviation, the largest the posterior can have, in the outcomes' units."""
        return float(self.outcomes.scale * np.sqrt(self.variance))

    def correlation(self, x: Shaped[FloatArray, "k p"]) -> Shaped[FloatArray, "k n"]:
        """(k, n) prior correlation of the points (k, p) with the data."""
        return matern52(self._distances(x, self.inputs), self.length_scale)

    def predict_mean(self, x: Shaped[FloatArray, "k p"]) -> Shaped[FloatArray, " k"]:
        """(k,) posterior mean at (k, p) kernel inputs."""
        return self.outcomes.restore(self.mean + self.correlation(x) @ self.weights)

    def predict(
        self, x: Shaped[FloatArray, "k p"]
    ) -> tuple[Shaped[FloatArray, " k"], Shaped[FloatArray, " k"]]:
        """(k,) posterior means and deviations at (k, p) kernel inputs; of noise, `predicted_noise` alone."""
        k = self.correlation(x)
        return self.outcomes.restore(self.mean + k @ self.weights), self.deviation(k)

    def deviation(self, correlation: Shaped[FloatArray, "k n"]) -> Shaped[FloatArray, " k"]:
        """(k,) posterior standard deviation of points whose (k, n) correlation with the data is given."""
        v = solve_triangular(self.factor, correlation.T, lower=True, check_finite=False)
        remaining = np.maximum(1.0 - np.einsum("ij,ij->j", v, v), _LEAST_VARIANCE)
        return self.signal_deviation * np.sqrt(remaining + self.predicted_noise)

    def predict_with_gradient(
        self, x: Shaped[FloatArray, "k p"]
    ) -> tuple[
        Shaped[FloatArray, " k"],
        Shaped[FloatArray, " k"],
        Shaped[FloatArray, "k p"],
        Shaped[FloatArray, "k p"],
    ]:
        """Posterior mean, deviation (k,) and their gradients (k, p); meant for few points."""
        k, slope = matern52_with_slope(self._distances(x, self.inputs), self.length_scale)
        q = k @ self._inverse
        remaining = np.maximum(1.0 - np.einsum("ij,ij->i", q, k), _LEAST_VARIANCE)
        deviation = self.signal_deviation * np.sqrt(remaining + self.predicted_noise)
        mean_gradient = self.outcomes.scale * _pull(slope * self.weights, x, self.inputs)
        variance_gradient = -2.0 * self.signal_deviation**2 * _pull(slope * q, x, self.inputs)
        mean = self.outcomes.restore(self.mean + k @ self.weights)
        return mean, deviation, mean_gradient, variance_gradient / (2.0 * deviation[:, None])

    def covariance(self, x: Shaped[FloatArray, "k p"]) -> Shaped[FloatArray, "k k"]:
        """(k, k) posterior covariance; k^3 work, meant for few points."""
        v = solve_triangular(self.factor, self.correlation(x).T, lower=True, check_finite=False)
        prior = matern52(exact_distances(x, x), self.length_scale)
        return self.signal_deviation**2 * (prior - v.T @ v)

    @cached_property
    def _distances(self) -> Callable[[FloatArray, FloatArray], FloatArray]:
        """The fast distances, unless the data lie too far from the origin for them."""
        farthest = float(np.linalg.norm(self.inputs, axis=1).max())
        fast = _FAST_ERROR * farthest <= _TOLERATED_ERROR * self.length_scale
        return fast_distances if fast else exact_distances

    @cached_property
    def _inverse(self) -> Shaped[FloatArray, "n n"]:
        inverse, _ = lapack.dpotri(self.factor, lower=1)
        return np.asarray(np.tril(inverse) + np.tril(inverse, -1).T)


def _pull(
    coefficients: Shaped[FloatArray, "k n"], x: Shaped[FloatArray, "k p"], inputs: Shaped[FloatArray, "n p"]
) -> Shaped[FloatArray, "k p"]:
    """(k, p) sum over data j of coefficients[:, j] * (x - inputs[j])."""
    return x * coefficients.sum(axis=1)[:, None] - coefficients @ inputs
