"""Ascent of an acquisition function under the bounds of all safety functions at once.

SLSQP (Kraft 1988) with exact gradients handles several constraints that are active together, where following
one gradient after another would creep along them. It may end slightly outside; then the line back to where it
began is searched for a point that is believed safe.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from hdsafebo.gp.warped_process import Posteriors
from hdsafebo.gp.warped_surrogate import SAFETY
from hdsafebo.typing import FloatArray

_ITERATIONS = 10
"""Of SLSQP: the models are wrong by more than further ones would gain, and the next round goes on."""
_TOLERANCE = 1e-6
"""Of the height, in standard deviations of the outcomes."""
_INSIDE = 1e-5
"""Margin that is aimed at, so that rounding, of the bounds and of the inputs, does not end outside."""
_BACK = 0.7
_SHORTEST = 1e-3
"""The line back is searched at shares of its length that shrink by `_BACK` down to this one."""


@dataclass(frozen=True)
class SafeMargins:
    """The safe set, standardised: mean + multiple * deviation >= floor, and deviation <= cap.

    Attributes:
        multiples: (m,) of the deviations, negative for a promise.
        floors: (m,) what the bounds must reach.
        caps: (m,) largest deviations; infinite ones demand nothing.
    """

    multiples: FloatArray
    floors: FloatArray
    caps: FloatArray

    def hold(self, posteriors: Posteriors, x: FloatArray) -> NDArray[np.bool_]:
        """(k,) True for the (k, d) points within the safe set."""
        mean, deviation = posteriors.over(x, SAFETY)
        bounds = mean + self.multiples[:, None] * deviation >= self.floors[:, None]
        return np.asarray((bounds & (deviation <= self.caps[:, None])).all(axis=0))


class Climb:
    """Height mean + kappa * deviation of the objective, and margins of the safe set, one point after another.

    Args:
        posteriors: of the objective and the safety functions.
        margins: the safe set.
        kappa: deviations in the height.
    """

    def __init__(self, posteriors: Posteriors, margins: SafeMargins, kappa: float) -> None:
        self._posteriors, self._margins, self._kappa = posteriors, margins, kappa
        self._capped = bool(np.isfinite(margins.caps).all())
        self._last: tuple[bytes, float, FloatArray, FloatArray, FloatArray] | None = None

    def at(self, u: FloatArray) -> tuple[bytes, float, FloatArray, FloatArray, FloatArray]:
        """The point, its height and (d,) gradient; (k,) margins, not negative where safe, and gradients."""
        key = u.tobytes()
        if self._last is None or self._last[0] != key:
            mean, deviation, by_mean, by_deviation = self._posteriors.at(u)
            limits = self._margins
            margins = mean[1:] + limits.multiples * deviation[1:] - limits.floors
            gradients = by_mean[1:] + limits.multiples[:, None] * by_deviation[1:]
            if self._capped:
                margins = np.concatenate([margins, limits.caps - deviation[1:]])
                gradients = np.concatenate([gradients, -by_deviation[1:]])
            height = float(mean[0] + self._kappa * deviation[0])
            self._last = key, height, by_mean[0] + self._kappa * by_deviation[0], margins, gradients
        return self._last

    def height(self, u: FloatArray) -> float:
        """At a point (d,); minus infinity where it is not believed safe."""
        _, height, _, margins, _ = self.at(u)
        return height if margins.min() >= 0 else -np.inf

    def from_starts(
        self, starts: Sequence[FloatArray], lower: FloatArray, upper: FloatArray
    ) -> FloatArray | None:
        """(d,) the highest point found in a box that is believed safe; None without one.

        Args:
            starts: points (d,) where ascents begin.
            lower, upper: (d,) of the box.
        """
        points = []
        for start in starts:
            begin = np.clip(start, lower, upper)
            points += [begin, self._back(begin, self._ascend(begin, lower, upper))]
        heights = [self.height(u) for u in points]
        if not heights:
            return None
        best = int(np.argmax(heights))
        return points[best] if np.isfinite(heights[best]) else None

    def _ascend(self, start: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
        """(d,) end of one ascent, safe or not."""

        def loss(u: FloatArray) -> tuple[float, FloatArray]:
            _, height, uphill, _, _ = self.at(u)
            return -height, -uphill

        found = minimize(
            loss,
            start,
            jac=True,
            method="SLSQP",
            bounds=np.column_stack([lower, upper]),
            constraints=[
                {"type": "ineq", "fun": lambda u: self.at(u)[3] - _INSIDE, "jac": lambda u: self.at(u)[4]}
            ],
            options={"maxiter": _ITERATIONS, "ftol": _TOLERANCE},
        )
        return np.clip(found.x, lower, upper) if np.isfinite(found.x).all() else start

    def _back(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """(d,) the first safe point on the line from an end back to its start; the start if there is none."""
        share = 1.0
        while share > _SHORTEST:
            point = start + share * (end - start)
            if self.at(point)[3].min() >= 0:
                return np.asarray(point)
            share *= _BACK
        return start
