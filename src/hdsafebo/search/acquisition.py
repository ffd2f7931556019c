"""Logarithms of expected improvement and probability of feasibility, with derivatives, and their ascent.

The logarithms stay finite and keep a gradient where the quantities themselves underflow
(Ament et al., Unexpected Improvements to Expected Improvement, NeurIPS 2023).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import fmin_l_bfgs_b
from scipy.special import erfcx, log_ndtr

from hdsafebo.typing import FloatArray, Shaped

Acquisition = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Takes (r, d) points, gives (r,) values and (r, d) gradients."""

_FAR = -1e3
"""Below this many standard deviations 1 - |u| R(|u|) loses its digits and its limit 1/u^2 has them all."""


def log_expected_improvement(
    mean: Shaped[FloatArray, " n"], sd: Shaped[FloatArray, " n"], best: float
) -> tuple[Shaped[FloatArray, " n"], Shaped[FloatArray, " n"], Shaped[FloatArray, " n"]]:
    """log E[max(0, f - best)] for f ~ N(mean, sd^2), and its derivatives in `mean` and in `sd`.

    Args:
        mean: (r,).
        sd: (r,) positive.
        best: incumbent.
    """
    u = (mean - best) / sd
    log_h, slope = _log_h(u)
    return np.log(sd) + log_h, slope / sd, (1.0 - u * slope) / sd


def log_feasibility(
    mean: Shaped[FloatArray, " n"], sd: Shaped[FloatArray, " n"], threshold: float
) -> tuple[Shaped[FloatArray, " n"], Shaped[FloatArray, " n"], Shaped[FloatArray, " n"]]:
    """log Pr(g >= threshold) for g ~ N(mean, sd^2), and its derivatives in `mean` and in `sd`."""
    v = (mean - threshold) / sd
    value = log_ndtr(v)
    slope = np.exp(-0.5 * v * v - 0.5 * np.log(2 * np.pi) - value)
    return np.asarray(value), slope / sd, -v * slope / sd


def maximise(
    acquisition: Acquisition,
    starts: Shaped[FloatArray, "s d"],
    lower: Shaped[FloatArray, " d"],
    upper: Shaped[FloatArray, " d"],
    max_iterations: int = 50,
) -> tuple[Shaped[FloatArray, " d"], float]:
    """Best point of a box that L-BFGS-B finds from several starts, ascended together.

    Args:
        acquisition: value and gradient of many points at once.
        starts: (r, d) within the box.
        lower: (d,) limits of the box.
        upper: (d,)
        max_iterations: of L-BFGS-B.

    Returns:
        The (d,) point and its value.
    """
    r, d = starts.shape

    def loss(flat: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = acquisition(flat.reshape(r, d))
        return -float(value.sum()), -gradient.ravel()

    # `minimize` would convert thousands of limits to lists and back for every ascent.
    box = list(zip(np.tile(lower, r).tolist(), np.tile(upper, r).tolist(), strict=True))
    flat, _, _ = fmin_l_bfgs_b(loss, starts.ravel(), bounds=box, maxiter=max_iterations)
    ends = np.clip(flat.reshape(r, d), lower, upper)
    values = acquisition(ends)[0]
    winner = int(np.argmax(values))
    return ends[winner], float(values[winner])


def _log_h(u: Shaped[FloatArray, " n"]) -> tuple[Shaped[FloatArray, " n"], Shaped[FloatArray, " n"]]:
    """log h(u) and h'(u) / h(u) of h(u) = phi(u) + u Phi(u), through Mills' ratio R = Phi / phi."""
    far = u < _FAR
    v = np.where(far, -1.0, u)
    ratio = np.sqrt(np.pi / 2) * erfcx(-v / np.sqrt(2))
    big = v > 5.0  # R grows like exp(u^2 / 2): use h itself
    h_over_phi = 1.0 + v * np.where(big, 1.0, ratio)
    w = np.where(big, v, 0.0)
    log_phi = -0.5 * v * v - 0.5 * np.log(2 * np.pi)
    cdf = np.exp(log_ndtr(w))
    h = np.exp(-0.5 * w * w) / np.sqrt(2 * np.pi) + w * cdf
    value = np.where(big, np.log(h), log_phi + np.log(h_over_phi))
    slope = np.where(big, cdf / h, np.where(big, 1.0, ratio) / h_over_phi)
    t = np.where(far, u, -1.0)
    value = np.where(far, -0.5 * t * t - 0.5 * np.log(2 * np.pi) - 2.0 * np.log(-t), value)
    return value, np.where(far, -t - 2.0 / t, slope)
