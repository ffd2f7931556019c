"""A Gaussian process with one length scale per dimension: posterior, its gradient, and joint samples."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from hdsafebo.kernel import exact_distances, fast_distances
from hdsafebo.optimizers.ard import ArdFit, ArdModel, correlation, fit_ard
from hdsafebo.problem import FloatArray

_FEATURES = 1024
"""Random Fourier features of a prior sample; the data correct it exactly (Wilson et al. 2020)."""


class ArdProcess:
    """Posterior of one outcome given (n, d) inputs in the unit cube and (n,) outcomes in their own units.

    Args:
        x: (n, d).
        y: (n,) standardised inside; equal outcomes get unit variance.
        model: kernel, limits and priors of the fit.
        start: earlier fit to start from.
        fit: hyper-parameters to use as they are, without fitting.

    Raises:
        SurrogateError: the covariance cannot be factorised.
    """

    def __init__(
        self,
        x: FloatArray,
        y: FloatArray,
        model: ArdModel,
        *,
        start: ArdFit | None = None,
        fit: ArdFit | None = None,
    ) -> None:
        self.x, self.y, self.model = x, y, model
        self.shift = float(y.mean())
        spread = float(y.std(ddof=1)) if len(y) > 1 else 0.0
        self.unit = spread if spread > 0 else 1.0
        standard = (y - self.shift) / self.unit
        self.fit = fit_ard(x, standard, model, start) if fit is None else fit
        self._scaled = x / self.fit.length_scales
        covariance = self._covariance(self._scaled, exact=True)
        covariance.flat[:: len(x) + 1] += self.fit.noise
        self._factor = cho_factor(covariance, lower=True)
        self._residual = standard - self.fit.mean
        self._alpha = cho_solve(self._factor, self._residual)

    def predict(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(r,) means and standard deviations of the noise-free outcome at (r, d) points."""
        cross = self._covariance(q / self.fit.length_scales)
        half = solve_triangular(self._factor[0], cross, lower=True)
        variance = np.maximum(self.fit.scale - np.einsum("ij,ij->j", half, half), 1e-12 * self.fit.scale)
        return self._back(cross.T @ self._alpha), self.unit * np.sqrt(variance)

    def predict_with_gradient(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """As `predict`, then the (r, d) gradients of both."""
        scaled = q / self.fit.length_scales
        squared = fast_distances(self._scaled, scaled) ** 2
        cross = self.fit.scale * correlation(squared, self.model.kernel)
        slope = self._slope(squared, cross)
        weights = cho_solve(self._factor, cross)
        variance = np.maximum(self.fit.scale - np.einsum("ij,ij->j", cross, weights), 1e-12 * self.fit.scale)
        sd = np.sqrt(variance)
        d_mean = self._pull(slope * self._alpha[:, None], scaled)
        d_sd = -self._pull(slope * weights, scaled) / sd[:, None]
        mean = self._back(cross.T @ self._alpha)
        return mean, self.unit * sd, self.unit * d_mean, self.unit * d_sd

    def paths(self, q: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
        """(count, r) joint posterior samples at (r, d) points.

        Matheron's rule: a prior sample, here of random Fourier features, plus the exact correction by the
        data (Wilson et al., Efficiently Sampling Functions from Gaussian Process Posteriors, ICML 2020).
        """
        d = self.x.shape[1]
        frequencies = rng.standard_normal((_FEATURES, d))
        if self.model.kernel == "matern52":
            frequencies *= np.sqrt(5.0 / rng.chisquare(5.0, _FEATURES))[:, None]
        phases = rng.uniform(0.0, 2 * np.pi, _FEATURES)
        weights = rng.standard_normal((_FEATURES, count)) * np.sqrt(2.0 * self.fit.scale / _FEATURES)
        scaled = q / self.fit.length_scales
        noise = np.sqrt(self.fit.noise) * rng.standard_normal((len(self.x), count))
        prior_here = np.cos(self._scaled @ frequencies.T + phases) @ weights + noise
        update = cho_solve(self._factor, self._residual[:, None] - prior_here)
        samples = np.cos(scaled @ frequencies.T + phases) @ weights + self._covariance(scaled).T @ update
        return np.asarray(self._back(samples).T)

    def believing(self, q: FloatArray) -> ArdProcess:
        """The process given its own mean at the (r, d) points `q` as well (the "kriging believer")."""
        if not len(q):
            return self
        more = ArdProcess.__new__(ArdProcess)
        more.x, more.y, more.model, more.fit = np.vstack([self.x, q]), self.y, self.model, self.fit
        more.shift, more.unit = self.shift, self.unit
        more._scaled = more.x / self.fit.length_scales
        covariance = more._covariance(more._scaled, exact=True)
        covariance.flat[:: len(more.x) + 1] += self.fit.noise
        more._factor = cho_factor(covariance, lower=True)
        believed = self._covariance(q / self.fit.length_scales).T @ self._alpha
        more._residual = np.concatenate([self._residual, believed])
        more._alpha = cho_solve(more._factor, more._residual)
        return more

    def _back(self, standard: FloatArray) -> FloatArray:
        """Standardised residuals in units of the outcome."""
        return np.asarray(self.shift + self.unit * (self.fit.mean + standard))

    def _covariance(self, scaled: FloatArray, *, exact: bool = False) -> FloatArray:
        """(n, r) covariance of the data with points that are divided by the length scales already."""
        distances = (exact_distances if exact else fast_distances)(self._scaled, scaled)
        return self.fit.scale * correlation(distances**2, self.model.kernel)

    def _slope(self, squared: FloatArray, cross: FloatArray) -> FloatArray:
        """s such that the gradient of the covariance in the query is s * (data - query), scaled units."""
        if self.model.kernel == "rbf":
            return cross
        a = np.sqrt(5.0 * squared)
        return np.asarray(self.fit.scale * (5.0 / 3.0) * (1.0 + a) * np.exp(-a))

    def _pull(self, weighted: FloatArray, scaled: FloatArray) -> FloatArray:
        """(r, d) sum_i weighted_ij (data_i - query_j), in units of the inputs."""
        pulled = weighted.T @ self._scaled - weighted.sum(axis=0)[:, None] * scaled
        return np.asarray(pulled / self.fit.length_scales)
