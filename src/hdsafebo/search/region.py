"""The trust region's length and how a round changes it (paper, Algorithm 2, SafeUpdate)."""

from __future__ import annotations

from dataclasses import dataclass, replace

IMPROVEMENT = 1e-3
"""A success is better than the best by this share of its size (TuRBO's code)."""


@dataclass(frozen=True)
class TrustRegionRule:
    """Constants of a trust region; the paper's names are in brackets.

    Attributes:
        initial: length at the start (l_0).
        least: smallest length (l_min).
        most: largest length (l_max).
        successes: successful rounds in a row after which the region grows (tau_s).
        failures: failed rounds in a row after which it shrinks (tau_f).
        factor: by which it grows and shrinks.
        restart: go back to the initial length when the smallest is reached, as Algorithm 2 does.
    """

    initial: float
    least: float
    most: float
    successes: int
    failures: int
    factor: float = 2.0
    restart: bool = True


@dataclass(frozen=True)
class TrustRegion:
    """Length (l_t) and counters (c_s, c_f)."""

    length: float
    successes: int = 0
    failures: int = 0


def safe_update(region: TrustRegion, success: bool, rule: TrustRegionRule, weight: int = 1) -> TrustRegion:
    """Algorithm 2 from its line 2 on, given whether the round was a success (line 1).

    Args:
        region: before the round.
        success: whether the round improved on the incumbent.
        rule: limits and tolerances.
        weight: failures that one failed round counts for (BAxUS counts every trial of a batch).

    The data stay: unlike in other trust-region methods, nothing is forgotten at the smallest length (lines
    10 to 12).
    """
    if success:
        region = replace(region, successes=region.successes + 1, failures=0)
    else:
        region = replace(region, successes=0, failures=region.failures + weight)
    if region.successes >= rule.successes:
        return TrustRegion(min(rule.factor * region.length, rule.most))
    if region.failures >= rule.failures:
        length = max(region.length / rule.factor, rule.least)
        return TrustRegion(rule.initial if rule.restart and length == rule.least else length)
    return region
