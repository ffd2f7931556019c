"""The trust region of TuRBO and its descendants: a box whose side doubles on success and halves on failure.

Eriksson, Pearce, Gardner, Turner and Poloczek, Scalable Global Optimization via Local Bayesian
Optimization, NeurIPS 2019, section 2 and supplement.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field, model_validator

from hdsafebo.optimizers.settings import OptimizerSettings
from hdsafebo.problem import FloatArray
from hdsafebo.sampling import sobol_points

_PERTURBED = 20
"""How many coordinates of the centre a candidate changes on average (TuRBO, supplement)."""
IMPROVEMENT = 1e-3
"""A success is better than the best by this share of its size (TuRBO's code)."""


class BoxRegionSettings(OptimizerSettings):
    """Settings of the methods with such a region; lengths are sides in widths of the box.

    Attributes:
        initial_length: L_0.
        max_length: L_max.
        min_length: L_min; below it the region restarts.
        success_tolerance: successes in a row that double the side (10 in BoTorch's tutorials of TuRBO and
            SCBO and in the paper, 3 in TuRBO's own).
        candidates: points that Thompson sampling chooses among; None takes min(5000, max(2000, 200 d)).
    """

    initial_length: float = Field(default=0.8, gt=0)
    max_length: float = Field(default=1.6, gt=0)
    min_length: float = Field(default=0.5**7, gt=0)
    success_tolerance: int = Field(default=10, ge=1)
    candidates: int | None = Field(default=None, ge=1)

    @model_validator(mode="after")
    def _ordered(self) -> BoxRegionSettings:
        if not self.min_length < self.initial_length <= self.max_length:
            raise ValueError(
                f"expected min_length < initial_length <= max_length, got "
                f"{self.min_length}, {self.initial_length}, {self.max_length}"
            )
        return self

    def candidate_count(self, dimension: int) -> int:
        """Number of candidates in d dimensions."""
        return self.candidates or min(5000, max(2000, 200 * dimension))


@dataclass(frozen=True)
class BoxRegion:
    """Side length and counters.

    Attributes:
        length: side in widths of the box.
        successes: in a row.
        failures: in a row.
    """

    length: float
    successes: int = 0
    failures: int = 0

    def after(
        self, success: bool, failure_tolerance: int, settings: BoxRegionSettings, weight: int = 1
    ) -> BoxRegion:
        """The region after a round.

        Args:
            success: whether the round improved on the best.
            failure_tolerance: failures in a row that halve the side.
            settings: limits and the success tolerance.
            weight: failures that one unsuccessful round counts for.
        """
        successes = self.successes + 1 if success else 0
        failures = 0 if success else self.failures + weight
        if successes >= settings.success_tolerance:
            return BoxRegion(min(2.0 * self.length, settings.max_length))
        if failures >= failure_tolerance:
            return BoxRegion(self.length / 2.0)
        return replace(self, successes=successes, failures=failures)


def failure_tolerance(dimension: int, batch: int) -> int:
    """Rounds without success that halve the side: ceil(max(4 / q, d / q)) (TuRBO, supplement)."""
    return int(np.ceil(max(4.0, dimension) / batch))


def relative_weights(length_scales: FloatArray) -> FloatArray:
    """(d,) length scales divided by their geometric mean: they shape the box and leave its volume."""
    return np.asarray(length_scales / np.exp(np.log(length_scales).mean()))


def box_candidates(
    centre: FloatArray, half_sides: FloatArray, count: int, rng: np.random.Generator
) -> FloatArray:
    """(count, d) points of the box around a point of the unit cube.

    Scrambled Sobol points, of which each keeps the centre's value in all but some 20 coordinates: in high
    dimension a change of all of them leaves little of what made the centre good.

    Args:
        centre: (d,) in the unit cube.
        half_sides: (d,), or one for all.
        count: number of points.
        rng: source of randomness.
    """
    d = len(centre)
    lower, upper = np.clip(centre - half_sides, 0.0, 1.0), np.clip(centre + half_sides, 0.0, 1.0)
    points = lower + (upper - lower) * sobol_points(count, d, rng)
    if d <= _PERTURBED:
        return points
    change = rng.random((count, d)) <= _PERTURBED / d
    none = np.flatnonzero(~change.any(axis=1))
    change[none, rng.integers(d, size=len(none))] = True
    return np.where(change, points, centre)


def distinct_maxima(samples: FloatArray) -> list[int]:
    """For each row the index of its largest value, all different: Thompson sampling without replacement."""
    chosen: list[int] = []
    for sample in samples:
        open_values = sample.copy()
        open_values[chosen] = -np.inf
        chosen.append(int(np.argmax(open_values)))
    return chosen
