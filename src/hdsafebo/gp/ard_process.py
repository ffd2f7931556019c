"""A Gaussian process with one length scale per dimension: posterior, its gradient, and joint samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cholesky, solve_triangular
from scipy.sparse import csr_array

from hdsafebo.errors import SurrogateError
from hdsafebo.gp.ard import ArdFit, ArdModel, correlation, fit_ard
from hdsafebo.gp.kernel import fast_distances
from hdsafebo.typing import FloatArray, Shaped

_FREQUENCIES = 512
"""Of the random Fourier features of a prior sample; the data correct it exactly (Wilson et al. 2020)."""
_NUGGET = 1e-6
"""Of the signal variance, added to believed points so that near ones stay factorisable."""
_JITTERS = (0.0, 1e-8, 1e-6, 1e-4)
_COLD_ITERATIONS = 100
_WARM_ITERATIONS = 10
"""Steps of a fit that starts from the last one: what is missing then follows in the next rounds."""
_SPARSE = 10
"""Products skip coordinates that candidates share when at least this many times those that differ."""

Pullback = Callable[[FloatArray, FloatArray], FloatArray]
"""Takes (r,) derivatives of a value in mean and deviation, gives its (r, d) gradient in the inputs."""


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
        x: Shaped[FloatArray, "n d"],
        y: Shaped[FloatArray, " n"],
        model: ArdModel,
        *,
        start: ArdFit | None = None,
        fit: ArdFit | None = None,
    ) -> None:
        self.x, self.y, self.model = x, y, model
        self.shift = float(y.mean())
        spread = float(y.std(ddof=1)) if len(y) > 1 else 0.0
        self.unit = spread if spread > 1e-12 * abs(self.shift) else 1.0
        standard = (y - self.shift) / self.unit
        steps = _COLD_ITERATIONS if start is None else _WARM_ITERATIONS
        self.fit = fit_ard(x, standard, model, start, steps) if fit is None else fit
        self._scaled = x / self.fit.length_scales
        self._norms = np.einsum("ij,ij->i", self._scaled, self._scaled)
        self._factor = self._factorise()
        self._residual = standard - self.fit.mean
        self._alpha = cho_solve(self._factor, self._residual)

    def predict(
        self, q: Shaped[FloatArray, "r d"]
    ) -> tuple[Shaped[FloatArray, " r"], Shaped[FloatArray, " r"]]:
        """(r,) means and standard deviations of the noise-free outcome at (r, d) points."""
        cross = self._covariance(q / self.fit.length_scales)
        half = solve_triangular(self._factor[0], cross, lower=True)
        variance = np.maximum(self.fit.scale - np.einsum("ij,ij->j", half, half), 1e-12 * self.fit.scale)
        return self._back(cross.T @ self._alpha), self.unit * np.sqrt(variance)

    def predict_with_pullback(
        self, q: Shaped[FloatArray, "r d"]
    ) -> tuple[Shaped[FloatArray, " r"], Shaped[FloatArray, " r"], Pullback]:
        """As `predict`, and what turns derivatives in both into a gradient in the inputs.

        The chain rule is applied before the sum over the data, which is the larger part of the work.
        """
        scaled = q / self.fit.length_scales
        squared = self._squared_distances(scaled)
        cross = self.fit.scale * correlation(squared, self.model.kernel)
        weights = cho_solve(self._factor, cross, check_finite=False)
        variance = np.maximum(self.fit.scale - np.einsum("ij,ij->j", cross, weights), 1e-12 * self.fit.scale)
        sd = np.sqrt(variance)

        def pullback(
            by_mean: Shaped[FloatArray, " r"], by_sd: Shaped[FloatArray, " r"]
        ) -> Shaped[FloatArray, "r d"]:
            of_data = self._alpha[:, None] * by_mean - weights * (by_sd / sd)
            weighted = self.unit * self._slope(squared, cross) * of_data
            pulled = weighted.T @ self._scaled - weighted.sum(axis=0)[:, None] * scaled
            return np.asarray(pulled / self.fit.length_scales)

        return self._back(cross.T @ self._alpha), self.unit * sd, pullback

    def paths(
        self,
        q: Shaped[FloatArray, "r d"],
        count: int,
        rng: np.random.Generator,
        centre: Shaped[FloatArray, " d"] | None = None,
    ) -> Shaped[FloatArray, "c r"]:
        """(count, r) joint posterior samples at (r, d) points.

        Matheron's rule: a prior sample, here of random Fourier features, plus the exact correction by the
        data (Wilson et al., Efficiently Sampling Functions from Gaussian Process Posteriors, ICML 2020).

        Args:
            q: the points.
            count: number of samples.
            rng: source of randomness.
            centre: (d,) point whose coordinates most points of `q` share; products of large matrices are
                then sparse ones.
        """
        m, d = _FREQUENCIES, self.x.shape[1]
        frequencies = rng.standard_normal((m, d))
        if self.model.kernel == "matern52":
            frequencies *= np.sqrt(5.0 / rng.chisquare(5.0, m))[:, None]
        weights = rng.standard_normal((2, m, count)) * np.sqrt(self.fit.scale / m)
        noise = np.sqrt(self.fit.noise) * rng.standard_normal((len(self.x), count))
        missed = self._residual[:, None] - _waves(self._scaled @ frequencies.T, weights) - noise
        update = cho_solve(self._factor, missed)
        products = _products(q, np.vstack([frequencies, self._scaled]) / self.fit.length_scales, centre)
        squared = self._squared_distances(q / self.fit.length_scales, products[:, m:].T)
        cross = self.fit.scale * correlation(squared, self.model.kernel)
        return np.asarray(self._back(_waves(products[:, :m], weights) + cross.T @ update).T)

    def believing(self, q: Shaped[FloatArray, "r d"]) -> ArdProcess:
        """The process as if its mean had been observed, without noise, at the (r, d) points `q` as well.

        This is the "kriging believer" of Ginsbourger, Le Riche and Carraro (2010); the factor is extended.
        """
        if not len(q):
            return self
        scaled = q / self.fit.length_scales
        cross = self._covariance(scaled)
        half = solve_triangular(self._factor[0], cross, lower=True)
        corner = self.fit.scale * correlation(fast_distances(scaled, scaled) ** 2, self.model.kernel)
        corner.flat[:: len(q) + 1] = (1.0 + _NUGGET) * self.fit.scale
        n, r = cross.shape
        factor = np.zeros((n + r, n + r), order="F")  # LAPACK's order: solving makes no copy
        factor[:n, :n], factor[n:, :n] = np.tril(self._factor[0]), half.T
        factor[n:, n:] = cholesky(corner - half.T @ half, lower=True)
        more = copy(self)
        more.x, more._scaled = np.vstack([self.x, q]), np.vstack([self._scaled, scaled])
        more._norms = np.concatenate([self._norms, np.einsum("ij,ij->i", scaled, scaled)])
        more._factor = (factor, True)
        more._residual = np.concatenate([self._residual, cross.T @ self._alpha])
        # A believed mean carries no information on the mean elsewhere.
        more._alpha = np.concatenate([self._alpha, np.zeros(r)])
        return more

    def _factorise(self) -> tuple[Shaped[FloatArray, "n n"], bool]:
        """Cholesky factor of the data's covariance, with as little jitter as it takes."""
        covariance = self._covariance(self._scaled)
        for jitter in _JITTERS:
            covariance.flat[:: len(covariance) + 1] = self.fit.noise + (1.0 + jitter) * self.fit.scale
            try:
                factor, lower = cho_factor(covariance, lower=True)
            except LinAlgError:
                continue
            return factor, lower
        raise SurrogateError(f"covariance of {len(covariance)} points has no Cholesky factor")

    def _back(self, standard: Shaped[FloatArray, " *s"]) -> Shaped[FloatArray, " *s"]:
        """Standardised residuals in units of the outcome."""
        return np.asarray(self.shift + self.unit * (self.fit.mean + standard))

    def _covariance(self, scaled: Shaped[FloatArray, "r d"]) -> Shaped[FloatArray, "n r"]:
        """(n, r) covariance of the data with points that are divided by the length scales already."""
        return self.fit.scale * correlation(self._squared_distances(scaled), self.model.kernel)

    def _squared_distances(
        self, scaled: Shaped[FloatArray, "r d"], products: Shaped[FloatArray, "n r"] | None = None
    ) -> Shaped[FloatArray, "n r"]:
        """(n, r) from the data, in length scales; `products` are the (n, r) inner products, if known."""
        squared = -2.0 * (self._scaled @ scaled.T if products is None else products)
        squared += self._norms[:, None]
        squared += np.einsum("ij,ij->i", scaled, scaled)
        return np.maximum(squared, 0.0, out=squared)

    def _slope(
        self, squared: Shaped[FloatArray, "n r"], cross: Shaped[FloatArray, "n r"]
    ) -> Shaped[FloatArray, "n r"]:
        """s such that the gradient of the covariance in the query is s * (data - query), scaled units."""
        if self.model.kernel == "rbf":
            return cross
        a = np.sqrt(5.0 * squared)
        return np.asarray(self.fit.scale * (5.0 / 3.0) * (1.0 + a) * np.exp(-a))


class BelievedPool:
    """Posterior at fixed points, kept up to date while points are believed one after another.

    Args:
        process: before the first belief.
        points: (k, d).

    Attributes:
        mean: (k,), which no belief changes.
    """

    def __init__(self, process: ArdProcess, points: Shaped[FloatArray, "k d"]) -> None:
        self._scaled = points / process.fit.length_scales
        cross = process._covariance(self._scaled)
        self._half = solve_triangular(process._factor[0], cross, lower=True, check_finite=False)
        self._unit, self._least = process.unit, 1e-12 * process.fit.scale
        self._variance = process.fit.scale - np.einsum("ij,ij->j", self._half, self._half)
        self.mean = process._back(cross.T @ process._alpha)

    @property
    def sd(self) -> Shaped[FloatArray, " k"]:
        """(k,) posterior standard deviations."""
        return self._unit * np.sqrt(np.maximum(self._variance, self._least))

    def follow(self, process: ArdProcess) -> None:
        """Take in the one point that `process` believes beyond those already taken in."""
        row = process._factor[0][-1]
        new = process._scaled[-1:]
        squared = fast_distances(new, self._scaled)[0] ** 2
        cross = process.fit.scale * correlation(squared, process.model.kernel)
        half = (cross - row[:-1] @ self._half) / row[-1]
        self._half = np.vstack([self._half, half])
        self._variance = self._variance - half * half


def _waves(
    phases: Shaped[FloatArray, "r m"], weights: Shaped[FloatArray, "2 m c"]
) -> Shaped[FloatArray, "r c"]:
    """(r, count) sums of cosines and sines of (r, m) phases with (2, m, count) weights."""
    return np.asarray(np.cos(phases) @ weights[0] + np.sin(phases) @ weights[1])


def _products(
    q: Shaped[FloatArray, "r d"], matrix: Shaped[FloatArray, "m d"], centre: Shaped[FloatArray, " d"] | None
) -> Shaped[FloatArray, "r m"]:
    """(r, m) q @ matrix', through the few coordinates in which the points differ from a centre."""
    if centre is not None:
        offsets = q - centre
        if _SPARSE * np.count_nonzero(offsets) <= offsets.size:
            return np.asarray(csr_array(offsets) @ matrix.T + matrix @ centre)
    return np.asarray(q @ matrix.T)


class WarmStart:
    """The last fit of every modelled function, from which the next one starts; plain arrays for saving."""

    def __init__(self) -> None:
        self._fits: dict[str, ArdFit] = {}

    def process(
        self, name: str, x: Shaped[FloatArray, "n d"], y: Shaped[FloatArray, " n"], model: ArdModel
    ) -> ArdProcess:
        """The process of a function, fitted from where its last fit ended."""
        start = self._fits.get(name)
        if start is not None and len(start.length_scales) != x.shape[1]:
            start = None
        process = ArdProcess(x, y, model, start=start)
        self._fits[name] = process.fit
        return process

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Hyper-parameters by name: length scales, then noise, scale, mean and density."""
        return {
            f"fit.{name}": np.array([*fit.length_scales, fit.noise, fit.scale, fit.mean, fit.log_density])
            for name, fit in self._fits.items()
        }

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]]) -> WarmStart:
        """The fits that `arrays` gave."""
        warm = cls()
        for key, values in arrays.items():
            if key.startswith("fit."):
                warm._fits[key.removeprefix("fit.")] = ArdFit(values[:-4].copy(), *values[-4:].tolist())
        return warm
