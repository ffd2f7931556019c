"""Sample paths of a posterior, and Thompson sampling with them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import cho_solve

from hdsafebo.gp.gaussian_process import GaussianProcess
from hdsafebo.gp.kernel import fast_distances, matern52_with_slope, spectral_frequencies
from hdsafebo.typing import FloatArray, IntArray, Shaped

ValueAndGradient = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
_FREQUENCIES = 512


class SamplePaths:
    """Samples of a Gaussian process' posterior as functions (Matheron's rule, Wilson et al. 2020).

    A path is a prior sample, approximated by random Fourier features, plus the kernel's interpolation of
    what it misses at the data. Its value costs n + 2M operations per point, at any number of points, where
    joint sampling at k points costs k^3.

    Args:
        gp: the fitted process.
        count: number of paths.
        rng: source of randomness.
        frequencies: M, features of the prior sample; all paths share them.
    """

    def __init__(
        self, gp: GaussianProcess, count: int, rng: np.random.Generator, frequencies: int = _FREQUENCIES
    ) -> None:
        self.gp = gp
        self.count = count
        self._omega = spectral_frequencies(frequencies, gp.inputs.shape[1], gp.length_scale, rng)
        scale = np.sqrt(gp.variance / frequencies)
        self._cosine = scale * rng.standard_normal((frequencies, count))
        self._sine = scale * rng.standard_normal((frequencies, count))
        noise = np.sqrt(gp.variance * gp.noise_ratios)[:, None]
        noise = noise * rng.standard_normal((len(gp.values), count))
        missed = (gp.values - gp.mean)[:, None] - self._prior(gp.inputs) - noise
        self._weights = cho_solve((gp.factor, True), missed, check_finite=False)

    def values(self, x: Shaped[FloatArray, "k p"]) -> Shaped[FloatArray, "k c"]:
        """(k, count) values of all paths at (k, p) kernel inputs, in the outcomes' units."""
        return self.gp.outcomes.restore(
            self.gp.mean + self._prior(x) + self.gp.correlation(x) @ self._weights
        )

    def value_and_gradient(
        self, x: Shaped[FloatArray, "c p"]
    ) -> tuple[Shaped[FloatArray, " c"], Shaped[FloatArray, "c p"]]:
        """(count,) value of each path at its own row of the (count, p) inputs, and (count, p) gradients."""
        gp = self.gp
        phase = x @ self._omega.T
        cosine, sine = np.cos(phase), np.sin(phase)
        k, slope = matern52_with_slope(fast_distances(x, gp.inputs), gp.length_scale)
        prior = np.einsum("bm,mb->b", cosine, self._cosine) + np.einsum("bm,mb->b", sine, self._sine)
        value = gp.mean + prior + np.einsum("bn,nb->b", k, self._weights)
        pull = slope * self._weights.T
        gradient = (cosine * self._sine.T - sine * self._cosine.T) @ self._omega
        gradient += x * pull.sum(axis=1)[:, None] - pull @ gp.inputs
        return gp.outcomes.restore(value), gp.outcomes.scale * gradient

    def _prior(self, x: Shaped[FloatArray, "k p"]) -> Shaped[FloatArray, "k c"]:
        phase = x @ self._omega.T
        return np.cos(phase) @ self._cosine + np.sin(phase) @ self._sine


def thompson_sample(
    gp: GaussianProcess, x: Shaped[FloatArray, "k p"], n: int, rng: np.random.Generator
) -> Shaped[IntArray, " n"]:
    """(n,) rows, all different, of (k, p) kernel inputs, each the best of a posterior sample of its own.

    The samples of a batch are independent, as in Kandasamy et al. (2018).
    """
    values = SamplePaths(gp, n, rng).values(x)
    chosen = np.empty(n, np.int64)
    for b in range(n):
        chosen[b] = np.argmax(values[:, b])
        values[chosen[b]] = -np.inf
    return chosen


def distinct_maxima(samples: Shaped[FloatArray, "n k"]) -> list[int]:
    """For each row the index of its largest value, all different: Thompson sampling without replacement."""
    chosen: list[int] = []
    for sample in samples:
        open_values = sample.copy()
        open_values[chosen] = -np.inf
        chosen.append(int(np.argmax(open_values)))
    return chosen
