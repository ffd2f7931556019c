"""Mean and standard error, paired comparisons over common seeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import stats

from hdsafebo.typing import FloatArray

SIGNIFICANCE = 0.05
# Two-sided signed-rank tests of fewer pairs cannot reach 5 %: 2 / 2^5 = 0.0625.
MIN_PAIRS = 6
EXACT_UP_TO = 13
"""Pairs whose signs are all gone through, as SciPy does with ties."""


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
        difference: mean of a - b over the finite ones, signed so that positive means a is better; infinite
            when there is none.
        interval: percentile bootstrap interval of the mean difference.
        p_value: two-sided Wilcoxon signed-rank test (zeros by Pratt's rule); 1 without differences.
        infinite: pairs of which one value is infinite; to the test they are the largest differences.
    """

    pairs: int
    difference: float
    interval: tuple[float, float]
    p_value: float
    infinite: int = 0

    def reversed(self) -> Comparison:
        """b compared with a."""
        low, high = self.interval
        return Comparison(self.pairs, -self.difference, (-high, -low), self.p_value, self.infinite)

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
        a: values by unit (a seed, or a task that was averaged over its seeds); -inf is worse than any value,
            NaN is none.
        b: the same for the other method.
        rng: draws the bootstrap samples.
        higher_is_better: sign of the comparison.
        samples: number of bootstrap samples.
        confidence: of the bootstrap interval.
    """
    both = pd.concat([a, b], axis=1, join="inner").dropna().to_numpy(float)
    both = both[np.isfinite(both).any(axis=1)]
    d = (both[:, 0] - both[:, 1]) * (1.0 if higher_is_better else -1.0)
    if len(d) == 0:
        nan = float("nan")
        return Comparison(0, nan, (nan, nan), 1.0)
    finite = d[np.isfinite(d)]
    if len(finite):
        means = finite[rng.integers(len(finite), size=(samples, len(finite)))].mean(axis=1)
        low, high = np.quantile(means, [(1 - confidence) / 2, (1 + confidence) / 2])
        difference = finite.mean()
    else:
        low, high, difference = d.min(), d.max(), d[0] if d.min() == d.max() else 0.0
    largest = np.abs(finite).max(initial=0.0) + 1.0
    ranked = np.clip(d, -largest, largest)
    return Comparison(
        len(d), float(difference), (float(low), float(high)), signed_rank(ranked), len(d) - len(finite)
    )


def signed_rank(d: FloatArray) -> float:
    """Two-sided p-value of Wilcoxon's signed-rank test, with Pratt's treatment of zeros.

    Args:
        d: (n,) paired differences.

    The same as `scipy.stats.wilcoxon` gives. With ties that ranks all 2^n choices of signs anew, a second for
    ten pairs; ranks do not depend on signs, and so are computed once.
    """
    if len(d) == 1 or not np.any(d):
        return 1.0
    if len(d) > EXACT_UP_TO:
        return float(stats.wilcoxon(d, zero_method="pratt").pvalue)
    ranks = np.sign(d) * stats.rankdata(np.abs(d))
    test = stats.permutation_test(
        (ranks,),
        lambda r, axis: np.where(r > 0, r, 0.0).sum(axis=axis),
        permutation_type="samples",
        vectorized=True,
    )
    return float(test.pvalue)
