"""The posterior of one function that was fitted with a length scale per input and warped outcomes.

In standardised units the posterior is Gaussian. In units of the outcomes it is not; shown there are its
median, and half the distance between the points that lie one standard deviation to both sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import lapack

from hdsafebo.gp.warped_fit import (
    Standard,
    WarpedFit,
    correlation,
    factor_with_jitter,
    profile,
    squared_distances,
)
from hdsafebo.typing import FloatArray

_LEAST_VARIANCE = 1e-10
"""Of the signal variance: rounding leaves no less."""
_NUGGET = 1e-6
"""Noise ratio of what is only believed, so that near points stay factorisable."""


@dataclass(frozen=True)
class WarpedProcess:
    """Posterior of one function.

    Attributes:
        inputs: (n, d) points of the unit cube.
        outcomes: how outcomes become what is modelled.
        fit: hyper-parameters.
        values: (n,) standardised outcomes.
        factor: (n, n) lower Cholesky factor of the correlation with noise.
        root: (n, n) inverse of the factor. 1 - |root k|^2 loses half as many digits as 1 - k' K^-1 k, which
            next to the data, where nearly all of the variance is explained, decide whether a bound holds.
        mean, variance: of the prior, standardised.
        weights: (n,) solution of the correlation for values - mean.
        jitter: what the diagonal needed beyond the noise.
        predicted_noise: variance of one measurement over the signal variance, added to predicted variances
            when predictions are of what will be measured; 0 when they are of the function.
    """

    inputs: FloatArray
    outcomes: Standard
    fit: WarpedFit
    values: FloatArray
    factor: FloatArray
    root: FloatArray
    mean: float
    variance: float
    weights: FloatArray
    jitter: float
    predicted_noise: float = 0.0

    @classmethod
    def of(
        cls, inputs: FloatArray, y: FloatArray, fit: WarpedFit, outcomes: Standard, measured: float = 0.0
    ) -> WarpedProcess:
        """The posterior given (n, d) points, their (n,) outcomes, and a fit to them.

        Args:
            measured: standardised variance of one measurement, when that is what is to be predicted.

        Raises:
            SurrogateError: the covariance cannot be factorised.
        """
        factor, jitter = factor_with_jitter(
            inputs / np.exp(fit.log_length_scales), float(np.exp(fit.log_noise))
        )
        root, _ = lapack.dtrtri(factor, lower=1)
        values = outcomes.apply(y)
        mean, variance, weights = profile(root.T @ root, values)
        noise = measured / variance
        return cls(inputs, outcomes, fit, values, factor, root, mean, variance, weights, jitter, noise)

    @cached_property
    def length_scales(self) -> FloatArray:
        """(d,) in sides of the unit cube."""
        return np.exp(self.fit.log_length_scales)

    @property
    def length_scale(self) -> float:
        """Their geometric mean."""
        return float(np.exp(np.mean(self.fit.log_length_scales)))

    @property
    def noise_variance(self) -> float:
        """Of an observation, standardised."""
        return float(np.exp(self.fit.log_noise)) * self.variance

    @property
    def signal_deviation(self) -> float:
        """Prior standard deviation, standardised."""
        return float(np.sqrt(self.variance))

    @cached_property
    def smoothed(self) -> FloatArray:
        """(n,) posterior mean at the data, standardised."""
        return np.asarray(self.values - self._ratio * self.weights)

    @cached_property
    def smoothed_deviation(self) -> FloatArray:
        """(n,) posterior deviation at the data, standardised; of noise, `predicted_noise` alone."""
        share = np.maximum(1.0 - self._ratio * np.einsum("ij,ij->j", self.root, self.root), 0.0)
        return self.signal_deviation * np.sqrt(self._ratio * share + self.predicted_noise)

    @property
    def _ratio(self) -> float:
        """Of what the data's diagonal has beyond the signal, over the signal."""
        return float(np.exp(self.fit.log_noise)) + self.jitter

    def correlation(self, x: FloatArray) -> FloatArray:
        """(k, n) prior correlation of (k, d) points with the data."""
        squared = squared_distances(x / self.length_scales, self.inputs / self.length_scales)
        return correlation(squared)[0]

    def standard_mean(self, correlation: FloatArray) -> FloatArray:
        """(k,) posterior means, standardised, of points whose (k, n) correlation with the data is given."""
        return np.asarray(self.mean + correlation @ self.weights)

    def standard_deviation(self, correlation: FloatArray) -> FloatArray:
        """(k,) posterior deviations, standardised, likewise; of noise, `predicted_noise` alone."""
        half = correlation @ self.root.T
        remaining = np.maximum(1.0 - np.einsum("ij,ij->i", half, half), _LEAST_VARIANCE)
        return self.signal_deviation * np.sqrt(remaining + self.predicted_noise)

    def predict_mean(self, x: FloatArray) -> FloatArray:
        """(k,) medians in the outcomes' units at (k, d) points."""
        return self.outcomes.restore(self.standard_mean(self.correlation(x)))

    def predict(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(k,) medians and deviations in the outcomes' units; see the module and `standard_deviation`."""
        k = self.correlation(x)
        mean, deviation = self.standard_mean(k), self.standard_deviation(k)
        low, middle, high = (self.outcomes.restore(mean + s * deviation) for s in (-1.0, 0.0, 1.0))
        return middle, 0.5 * (high - low)


@dataclass(frozen=True)
class _Believed:
    """Points at which the first process is told its own mean: b of them.

    Attributes:
        scaled: (b, d) in length scales.
        solved: (n, b) inverse correlation of the data times their correlation with the points.
        inverse: (b, b) of the points' posterior correlation.
    """

    scaled: FloatArray
    solved: FloatArray
    inverse: FloatArray


class Posteriors:
    """Several processes over the same points, for values and gradients at one point after another.

    Args:
        processes: m of them; the first one may be told its own mean (see `believing`).
    """

    def __init__(self, processes: Sequence[WarpedProcess]) -> None:
        self.lengths = np.array([p.length_scales for p in processes])  # (m, d)
        self.mean = np.array([p.mean for p in processes])
        self.signal = np.array([p.signal_deviation for p in processes])
        self.noise = np.array([p.predicted_noise for p in processes])
        self._scaled = processes[0].inputs / self.lengths[:, None, :]  # (m, n, d)
        self._norms = np.einsum("mnd,mnd->mn", self._scaled, self._scaled)
        self._roots = np.array([p.root for p in processes])  # (m, n, n)
        self._weights = np.array([p.weights for p in processes])  # (m, n)
        self._believed: _Believed | None = None

    @property
    def known(self) -> FloatArray:
        """(n + b, d) points of the data, and those at which the first process believes its mean."""
        scaled = self._scaled[0]
        if self._believed is not None:
            scaled = np.vstack([scaled, self._believed.scaled])
        return np.asarray(scaled * self.lengths[0])

    def at(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Means and deviations (m,) at the point (d,), standardised, and their gradients (m, d)."""
        q = u / self.lengths
        squared = self._norms - 2.0 * (self._scaled @ q[:, :, None])[:, :, 0] + (q * q).sum(axis=1)[:, None]
        k, slope = correlation(np.maximum(squared, 0.0))
        half = (self._roots @ k[:, :, None])[:, :, 0]
        solved = (half[:, None, :] @ self._roots)[:, 0]
        remaining = 1.0 - (half * half).sum(axis=1)
        believed = self._believed
        if believed is not None:
            apart = believed.scaled - q[0]
            near, steep = correlation((apart * apart).sum(axis=1))
            shared = near - k[0] @ believed.solved
            told = believed.inverse @ shared
            remaining[0] -= shared @ told
            solved[0] -= believed.solved @ told
        pulls = slope[:, None, :] * np.stack([self._weights, -2.0 * solved], axis=1)
        gradients = pulls @ self._scaled - pulls.sum(axis=2)[:, :, None] * q[:, None, :]  # (m, 2, d)
        if believed is not None:
            gradients[0, 1] -= 2.0 * (told * steep) @ apart
        gradients /= self.lengths[:, None, :]
        root = np.sqrt(np.maximum(remaining, _LEAST_VARIANCE) + self.noise)
        by_deviation = gradients[:, 1] * (0.5 * self.signal / root)[:, None]
        mean = self.mean + (k * self._weights).sum(axis=1)
        return mean, self.signal * root, gradients[:, 0], by_deviation

    def over(self, x: FloatArray, which: slice = slice(None)) -> tuple[FloatArray, FloatArray]:
        """Means and deviations (m', k) of some processes at (k, d) points, standardised."""
        means, deviations = [], []
        for j in range(len(self.lengths))[which]:
            scaled = x / self.lengths[j]
            k, _ = correlation(squared_distances(scaled, self._scaled[j]))
            means.append(self.mean[j] + k @ self._weights[j])
            half = k @ self._roots[j].T
            remaining = 1.0 - np.einsum("ij,ij->i", half, half)
            if j == 0 and self._believed is not None:
                shared = self._shared(scaled, k, self._believed)
                remaining -= np.einsum("ij,ij->i", shared @ self._believed.inverse, shared)
            remaining = np.maximum(remaining, _LEAST_VARIANCE) + self.noise[j]
            deviations.append(self.signal[j] * np.sqrt(remaining))
        return np.array(means), np.array(deviations)

    def believing(self, points: FloatArray) -> Posteriors:
        """The same as if the first process' mean at (k, d) points had been observed: its deviations shrink.

        This is the kriging believer of Ginsbourger, Le Riche and Carraro (2010).
        """
        if len(points) == 0:
            return self
        scaled = points / self.lengths[0]
        if self._believed is not None:
            scaled = np.vstack([self._believed.scaled, scaled])
        k, _ = correlation(squared_distances(scaled, self._scaled[0]))
        solved = self._roots[0].T @ (self._roots[0] @ k.T)
        own, _ = correlation(squared_distances(scaled, scaled))
        posterior = own - k @ solved
        posterior.flat[:: len(scaled) + 1] = np.maximum(np.diag(posterior), 0.0) + _NUGGET
        more = copy(self)
        more._believed = _Believed(scaled, solved, np.linalg.pinv(posterior, hermitian=True))
        return more

    @staticmethod
    def _shared(scaled: FloatArray, k: FloatArray, believed: _Believed) -> FloatArray:
        """(k, b) posterior correlation of points with the believed ones."""
        near, _ = correlation(squared_distances(scaled, believed.scaled))
        return np.asarray(near - k @ believed.solved)
