"""Statistics against closed forms and against an independent implementation."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from scipy.stats import norm

from hdsafebo.report.stats.statistics import Comparison, compare, estimate, signed_rank


def versus(a: list[float], b: list[float], *, higher_is_better: bool = True) -> Comparison:
    units = [str(k) for k in range(len(a))]
    rng = np.random.default_rng(1)
    return compare(
        pd.Series(a, units),
        pd.Series(b, units[: len(b)]),
        rng,
        higher_is_better=higher_is_better,
        samples=2000,
        confidence=0.95,
    )


def test_mean_and_standard_error() -> None:
    e = estimate([1.0, 2.0, 3.0, 4.0, float("nan")])
    assert (e.mean, e.runs) == (2.5, 4)
    assert e.se == pytest.approx(math.sqrt(5 / 3 / 4))
    assert e.std == pytest.approx(math.sqrt(5 / 3))
    assert math.isnan(estimate([2.0]).se)
    assert estimate([]).runs == 0


def test_six_pairs_can_be_significant_and_five_cannot() -> None:
    six = versus([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [0.0] * 6)
    assert six.p_value == pytest.approx(2 / 2**6)
    assert six.difference == 3.5
    assert six.better
    assert not six.worse
    five = versus([1.0, 2.0, 3.0, 4.0, 5.0], [0.0] * 5)
    assert five.interval[0] > 0
    assert not five.significant


def test_lower_is_better_turns_the_sign() -> None:
    c = versus([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [0.0] * 6, higher_is_better=False)
    assert c.difference == -3.5
    assert c.worse


def test_reversal() -> None:
    c = versus([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [0.0] * 6)
    back = c.reversed()
    assert back.difference == -c.difference
    assert back.interval == (-c.interval[1], -c.interval[0])
    assert back.worse
    assert back.reversed() == c


def test_only_common_units_count() -> None:
    assert versus([1.0, 2.0, 3.0], [0.0, 1.0]).pairs == 2
    assert versus([1.0, 2.0], [float("nan"), 1.0]).pairs == 1


def test_what_found_nothing_is_worse_than_any_value() -> None:
    nothing = -math.inf
    some = versus([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [0.5, 0.5, nothing, nothing, nothing, nothing])
    assert (some.pairs, some.infinite, some.difference) == (6, 4, 1.0)
    assert some.p_value == pytest.approx(2 / 2**6, abs=0.01)
    assert some.better
    assert some.reversed().worse
    none = versus([-3.0] * 6, [nothing] * 6)
    assert none.difference == math.inf
    assert none.better
    assert none.reversed().worse
    assert versus([nothing] * 6, [nothing] * 6).pairs == 0
    mixed = versus([1.0, nothing] * 3, [nothing, 1.0] * 3)
    assert (mixed.difference, mixed.significant) == (0.0, False)


def test_equal_methods_are_not_significant() -> None:
    c = versus([1.0] * 8, [1.0] * 8)
    assert (c.difference, c.p_value, c.significant) == (0.0, 1.0, False)


def test_nothing_in_common() -> None:
    c = versus([1.0], [])
    assert c.pairs == 0
    assert not c.significant


def test_bootstrap_interval_has_its_coverage() -> None:
    rng = np.random.default_rng(5)
    hits = 0
    for _ in range(300):
        d = pd.Series(rng.normal(0.3, 1.0, 40)).rename(index=str)
        c = compare(d, d * 0, rng, higher_is_better=True, samples=400, confidence=0.9)
        hits += c.interval[0] <= 0.3 <= c.interval[1]
    assert 0.84 <= hits / 300 <= 0.95


def test_rate_of_false_significance_is_at_most_five_percent() -> None:
    rng = np.random.default_rng(6)
    false = 0
    for _ in range(400):
        d = pd.Series(rng.normal(0.0, 1.0, 10)).rename(index=str)
        false += compare(d, d * 0, rng, higher_is_better=True, samples=300, confidence=0.95).significant
    assert false / 400 <= 0.05 + 2 * math.sqrt(0.05 * 0.95 / 400)


def test_guarantee_of_beta_two() -> None:
    assert norm.sf(2.0) == pytest.approx(0.0228, abs=5e-5), "the number that the page calls vacuous"


@pytest.mark.parametrize("decimals", [0, 1, 8])
@pytest.mark.parametrize("pairs", [1, 5, 8, 15])
def test_the_signed_rank_test_is_that_of_scipy(pairs: int, decimals: int) -> None:
    for seed in range(3):
        d = np.random.default_rng(seed).normal(0.4, 1.0, pairs).round(decimals)
        expected = stats.wilcoxon(d, zero_method="pratt").pvalue if d.any() else 1.0
        assert signed_rank(d) == pytest.approx(expected, rel=1e-12)
