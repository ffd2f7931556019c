"""Which points are believed safe, how probably, and what believing it can cost.

With mu and sigma of a safety function g at a point, u = mu + beta * sigma. Proposition 1 of the paper:
Phi(beta) <= 1 - alpha gives Pr(g >= u) >= alpha, so a point with u >= h is safe with probability at least
alpha = 1 - Phi(beta). Beta = 2 promises no more than 0.023; a promise above one half needs a negative beta.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr, ndtri

from hdsafebo.errors import ParamsError
from hdsafebo.typing import FloatArray, Shaped

_SQRT_2PI = np.sqrt(2.0 * np.pi)


def beta_of(alpha: float) -> float:
    """The largest beta that promises the safe probability `alpha`: Phi^-1(1 - alpha).

    Raises:
        ParamsError: alpha is not strictly between 0 and 1.
    """
    if not 0.0 < alpha < 1.0:
        raise ParamsError(f"alpha: expected a probability strictly between 0 and 1, got {alpha}")
    return float(-ndtri(alpha))


def alpha_of(beta: float) -> float:
    """The safe probability that `beta` promises: 1 - Phi(beta)."""
    return float(ndtr(-beta))


def safe_probabilities(
    mean: Shaped[FloatArray, "n m"],
    deviation: Shaped[FloatArray, "n m"],
    thresholds: Shaped[FloatArray, " m"],
) -> Shaped[FloatArray, "n m"]:
    """(n, m) probability that each safety function meets its threshold.

    Args:
        mean: (n, m) posterior means.
        deviation: (n, m) posterior standard deviations, positive.
        thresholds: (m,).
    """
    return np.asarray(ndtr((mean - thresholds) / deviation))


def violation_bound(
    mean: Shaped[FloatArray, "n m"],
    deviation: Shaped[FloatArray, "n m"],
    thresholds: Shaped[FloatArray, " m"],
    beta: float | None,
) -> Shaped[FloatArray, " n"]:
    """(n,) bound on the expected violation sum_j max(0, h_j - g_j), given the data.

    For a Gaussian g, E[max(0, h - g)] = sigma (t Phi(t) + phi(t)) with t = (h - mu) / sigma. It grows with t,
    and u >= h means t <= beta: within the safe set it is at most sigma (beta Phi(beta) + phi(beta)).
    Outside, where t exceeds beta, the expectation itself is returned, so the bound always holds. (The paper's
    Lemma 2 takes a random term out of the expectation of an indicator; this is the bound that can be
    shown for one step.)

    Args:
        mean: (n, m) posterior means.
        deviation: (n, m) posterior standard deviations.
        thresholds: (m,).
        beta: of the safe set; None gives the expectation itself.
    """
    t = (thresholds - mean) / deviation
    if beta is not None:
        t = np.maximum(t, beta)
    return np.asarray((deviation * (t * ndtr(t) + np.exp(-0.5 * t * t) / _SQRT_2PI)).sum(axis=1))
