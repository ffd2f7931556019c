"""What is constant within a day and differs between days.

Model of an outcome: y = m + f(x) + b_day + noise, f a Gaussian process with the Matern-5/2 kernel, b_day
normal and independent between days. The hyper-parameters with the highest likelihood are taken from a small
grid, with m and the scale of all variances in closed form (Rasmussen and Williams 2006, sections 2.7 and
5.4.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, product
from operator import itemgetter

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from hdsafebo.gp.kernel import exact_distances, matern52
from hdsafebo.typing import FloatArray, IntArray

_LENGTHS = (0.5, 1.0, 2.0)  # in median distances of the data
_NOISES = (0.03, 0.1)  # variances over that of f
_DAYS = (0.0, 0.03, 0.1)
_JITTER = 1e-8


Theta = tuple[float, float, float]
"""Length scale in median distances of the data; variances of noise and of days over that of f."""
GRID: tuple[Theta, ...] = tuple(product(_LENGTHS, _NOISES, _DAYS))


@dataclass(frozen=True)
class DayModel:
    """The fitted parts at the data, (n, m) each, in the outcomes' units.

    Attributes:
        value: posterior mean of m + f.
        effect: posterior mean of the day's effect.
        theta: of each of the m outcomes.
        signal: (m,) prior standard deviation of f.
    """

    value: FloatArray
    effect: FloatArray
    theta: tuple[Theta, ...]
    signal: FloatArray


def fit_days(
    inputs: FloatArray, outcomes: FloatArray, days: IntArray, grid: Sequence[Theta] = GRID
) -> DayModel:
    """Fit each of the outcomes by itself.

    Args:
        inputs: (n, p) kernel inputs, n >= 1.
        outcomes: (n, m) finite outcomes.
        days: (n,) number of the day of each trial.
        grid: hyper-parameters to choose from.
    """
    n = len(inputs)
    signal = np.zeros(outcomes.shape[1])
    # Squares of 1e200 are infinite; a power of two changes no digit.
    size = np.exp2(np.floor(np.log2(np.maximum(np.abs(outcomes).max(axis=0), np.finfo(float).tiny))))
    centre, scale = (outcomes / size).mean(axis=0), (outcomes / size).std(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    columns = np.column_stack([(outcomes / size - centre) / scale, np.ones(n)])
    distances = exact_distances(inputs, inputs)
    reference = float(np.median(distances)) or 1.0
    same_day = (days[:, None] == days).astype(float)
    highest = np.full(outcomes.shape[1], -np.inf)
    value, effect = np.zeros(outcomes.shape), np.zeros(outcomes.shape)
    chosen = [grid[0]] * outcomes.shape[1]
    for length, among in groupby(grid, key=itemgetter(0)):
        kernel = matern52(distances, length * reference)
        for theta in among:
            _, noise, day = theta
            covariance = kernel + day * same_day
            covariance.flat[:: n + 1] += noise + _JITTER
            factor = cholesky(covariance, lower=True, overwrite_a=True, check_finite=False)
            half = solve_triangular(factor, columns, lower=True, check_finite=False)
            one = half[:, -1]
            mean = one @ half[:, :-1] / (one @ one)
            residual = half[:, :-1] - one[:, None] * mean
            variance = np.maximum((residual**2).mean(axis=0), 1e-300)
            likelihood = -0.5 * n * np.log(variance) - np.log(np.diag(factor)).sum()
            better = likelihood > highest
            if better.any():
                weights = solve_triangular(
                    factor, residual[:, better], lower=True, trans=1, check_finite=False
                )
                value[:, better] = mean[better] + kernel @ weights
                effect[:, better] = day * (same_day @ weights)
                highest[better] = likelihood[better]
                signal[better] = np.sqrt(variance[better])
                for column in np.flatnonzero(better):
                    chosen[column] = theta
    scale *= size
    return DayModel(centre * size + scale * value, scale * effect, tuple(chosen), scale * signal)


def day_deviation(inputs: FloatArray, days: IntArray, row: int, theta: Theta, signal: float) -> float:
    """Posterior standard deviation of m + f at one of the trials, in the outcome's units.

    Args:
        inputs, days: of all trials, as they were fitted.
        row: the trial.
        theta, signal: of one outcome's model.
    """
    length, noise, day = theta
    distances = exact_distances(inputs, inputs)
    kernel = matern52(distances, length * (float(np.median(distances)) or 1.0))
    covariance = kernel + day * (days[:, None] == days)
    covariance.flat[:: len(inputs) + 1] += noise + _JITTER
    factor = cholesky(covariance, lower=True, overwrite_a=True, check_finite=False)
    columns = np.column_stack([kernel[row], np.ones(len(inputs))])
    known, one = solve_triangular(factor, columns, lower=True, check_finite=False).T
    variance = 1.0 - known @ known + (1.0 - one @ known) ** 2 / (one @ one)
    return float(signal * np.sqrt(max(variance, 0.0)))
