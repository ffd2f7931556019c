"""Mean and standard error, paired comparisons over common seeds, exact binomial intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy import stats

SIGNIFICANCE = 0.05
# Two-sided signed-rank tests of fewer pairs cannot reach 5 %: 2 / 2^5 = 0.0625.
MIN_PAIRS = 6


@dataclass(frozen=True)
class Estimate:
    """A mean over runs.

    Attributes:
        mean: NaN when no run has a value.
        se: standard error, sample standard deviation / sqrt(runs); NaN with fewer than two runs.
        runs: runs that have a value.
    """

    mean: float
    se: float
    runs: int

    @property
    def std(self) -> float:
        """Sample standard deviation over the runs."""
        return self.se * float(np.sqrt(self.runs))


@dataclass(frozen=True)
class Comparison:
    """Paired difference a - b over the units (seeds) that both have.

    Attributes:
        pairs: number of common units.
        difference: mean of a - b, signed so that positive means a is better.
        interval: percentile bootstrap interval of the mean difference.
        p_value: two-sided Wilcoxon signed-rank test (zeros by Pratt's rule); 1 without differences.
    """

    pairs: int
    difference: float
    interval: tuple[float, float]
    p_value: float

    def reversed(self) -> Comparison:
        """b compared with a."""
        return Comparison(self.pairs, -self.difference, (-self.interval[1], -self.interval[0]), self.p_value)

    @property
    def significant(self) -> bool:
        """Whether test and interval both exclude equality, with pairs enough for the test to be able to."""
        low, high = self.interval
        return self.pairs >= MIN_PAIRS and self.p_value < SIGNIFICANCE and (low > 0 or high < 0)

    @property
    def better(self) -> bool:
        """a is significantly better than b."""
        return self.significant and self.difference > 0

    @property
    def worse(self) -> bool:
        """a is significantly worse than b."""
        return self.significant and self.difference < 0


def estimate(values: ArrayLike) -> Estimate:
    """Mean and standard error of the finite ones among `values`."""
    x = np.asarray(values, float)
    x = x[np.isfinite(x)]
    if len(x) == 0:
        return Estimate(float("nan"), float("nan"), 0)
    se = float(x.std(ddof=1) / np.sqrt(len(x))) if len(x) > 1 else float("nan")
    return Estimate(float(x.mean()), se, len(x))


def compare(
    a: pd.Series,
    b: pd.Series,
    rng: np.random.Generator,
    *,
    higher_is_better: bool,
    samples: int,
    confidence: float,
) -> Comparison:
    """Compare two methods on their common units.

    Args:
        a: values by unit (a seed, or a task that was averaged over its seeds).
        b: the same for the other method.
        rng: draws the bootstrap samples.
        higher_is_better: sign of the comparison.
        samples: number of bootstrap samples.
        confidence: of the bootstrap interval.
    """
    both = pd.concat([a, b], axis=1, join="inner").dropna().to_numpy(float)
    d = (both[:, 0] - both[:, 1]) * (1.0 if higher_is_better else -1.0)
    if len(d) == 0:
        nan = float("nan")
        return Comparison(0, nan, (nan, nan), 1.0)
    means = d[rng.integers(len(d), size=(samples, len(d)))].mean(axis=1)
    low, high = np.quantile(means, [(1 - confidence) / 2, (1 + confidence) / 2])
    p_value = float(stats.wilcoxon(d, zero_method="pratt").pvalue) if np.any(d) else 1.0
    return Comparison(len(d), float(d.mean()), (float(low), float(high)), p_value)


def clopper_pearson(
    successes: ArrayLike, trials: ArrayLike, confidence: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Exact binomial interval (Clopper and Pearson 1934), elementwise.

    Args:
        successes: k.
        trials: n >= 1.
        confidence: coverage, at least.

    Returns:
        Lower and upper limits of the success probability.
    """
    k, n = np.asarray(successes, float), np.asarray(trials, float)
    tail = (1 - confidence) / 2
    with np.errstate(invalid="ignore"):
        low = np.where(k == 0, 0.0, stats.beta.ppf(tail, k, n - k + 1))
        high = np.where(k == n, 1.0, stats.beta.ppf(1 - tail, k + 1, n - k))
    return np.asarray(low), np.asarray(high)
