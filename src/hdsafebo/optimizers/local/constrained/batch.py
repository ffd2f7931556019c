"""The trials of one round of `constrained`, chosen one after another."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hdsafebo.gp.warped_process import Posteriors
from hdsafebo.gp.warped_surrogate import SAFETY
from hdsafebo.optimizers.local.constrained.ascent import Climb, SafeMargins
from hdsafebo.typing import FloatArray

_CANDIDATES = 500
"""Points of which the best believed safe ones are where ascents begin."""
_NEAREST, _FARTHEST = 1e-3, 1.0
"""Range of the distances at which candidates lie around good trials, in half sides of the box."""
_DIRECTIONS = 20
"""Random ones of which a probe takes that with the best worst bound."""
_SHORTER = (1.0, 0.25, 0.06)
"""Shares of a probe's distance."""
_APART = 1e-3
"""Sides of the cube; a point closer to a known one tells little and is computed again."""
_RETRIES = 1


@dataclass
class Batch:
    """A round in the making; points are those of the unit cube, in the dimensions that vary.

    Attributes:
        incumbent: (d,) around which it looks.
        margins: the safe set.
        posteriors: of all functions; the objective is told its own mean at points that are chosen or open.
        candidates: (k, d).
        rng: source of randomness.
        limits: least and largest coordinate.
        chosen: points so far.
    """

    incumbent: FloatArray
    margins: SafeMargins
    posteriors: Posteriors
    candidates: FloatArray
    rng: np.random.Generator
    limits: tuple[float, float]
    chosen: list[FloatArray] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._safe = self.candidates[self.margins.hold(self.posteriors, self.candidates)]

    def probe(self, distance: float) -> None:
        """Add the believed safe point with the best worst bound of random directions, if there is one.

        Args:
            distance: from the incumbent; shorter ones are tried when no point that far is believed safe.
        """
        for share in _SHORTER:
            steps = self.rng.standard_normal((_DIRECTIONS, len(self.incumbent)))
            steps *= share * distance / np.linalg.norm(steps, axis=1, keepdims=True)
            points = np.clip(self.incumbent + steps, *self.limits)
            points = points[self.margins.hold(self.posteriors, points)]
            if len(points):
                mean, deviation = self.posteriors.over(points, SAFETY)
                slack = (mean - self.margins.floors[:, None]) / deviation + self.margins.multiples[:, None]
                self._add(points[slack.min(axis=0).argmax()])
                return

    def climb(self, kappa: float, reach: float) -> None:
        """Add the end of an ascent of mean + kappa * deviation, away from all known points.

        Args:
            kappa: at first; it grows while the ascent ends where something is known.
            reach: half side of the box of this ascent.
        """
        lower, upper = _box(self.incumbent, reach, self.limits)
        inside = self._safe[(np.abs(self._safe - self.incumbent) <= reach + 1e-12).all(axis=1)]
        mean, deviation = (v[0] for v in self.posteriors.over(inside, slice(1)))
        starts = [self.incumbent]
        for _ in range(1 + _RETRIES):
            best = inside[np.argsort(-(mean + kappa * deviation), kind="stable")]
            climb = Climb(self.posteriors, self.margins, kappa)
            point = climb.from_starts([*best[:1], *starts], lower, upper)
            if point is not None and self.fresh(point[None])[0]:
                self._add(point)
                return
            kappa, starts = 2.0 * kappa + 2.0, []
        left = best[self.fresh(best)]
        if len(left):
            self._add(left[0])

    def others(self, least: int) -> FloatArray:
        """(k, d) candidates for what is missing: the fresh ones, or all of them when those are too few."""
        fresh = self.candidates[self.fresh(self.candidates)]
        return fresh if len(fresh) >= least else self.candidates

    def fresh(self, points: FloatArray) -> NDArray[np.bool_]:
        """(k,) True for points (k, d) that lie apart from all known, open and chosen ones."""
        known = self.posteriors.known
        return np.array([np.linalg.norm(known - u, axis=1).min() >= _APART for u in points], bool)

    def _add(self, point: FloatArray) -> None:
        self.chosen.append(point)
        self.posteriors = self.posteriors.believing(point[None])


def _box(middle: FloatArray, half: float, limits: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Corners (d,) of a box of a half side around a point, within limits."""
    return np.maximum(limits[0], middle - half), np.minimum(limits[1], middle + half)


def candidates_around(
    incumbent: FloatArray,
    good: FloatArray,
    near: float,
    box: float,
    limits: tuple[float, float],
    rng: np.random.Generator,
) -> FloatArray:
    """(k, d) points: good ones, uniform ones in a box, steps from good ones, and steps along some axes.

    Args:
        incumbent: (d,).
        good: (g, d) the best trials.
        near: half side of the present region; steps are at most that long.
        box: half side of the box of the uniform ones.
        limits: least and largest coordinate.
        rng: source of randomness.
    """
    d, m = len(incumbent), _CANDIDATES // 3
    lower, upper = _box(incumbent, box, limits)

    def length() -> FloatArray:
        return near * np.exp(rng.uniform(np.log(_NEAREST), np.log(_FARTHEST), (m, 1)))

    uniform = lower + (upper - lower) * rng.random((m, d))
    steps = good[np.arange(m) % len(good)] + length() * rng.standard_normal((m, d)) / np.sqrt(d)
    axes = incumbent + length() * rng.uniform(-1.0, 1.0, (m, d)) * (rng.random((m, d)) < 0.5)
    return np.clip(np.concatenate([good, uniform, steps, axes]), lower, upper)
