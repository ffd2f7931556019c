"""Gradient ascent within the safe set and a ball."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdsafebo.search.metric import Metric
from hdsafebo.typing import BoolArray, FloatArray, Shaped

ValueAndGradient = Callable[[FloatArray], tuple[FloatArray, FloatArray]]

_FIRST_STEP = 0.35
"""Of the radius: three steps reach the border of the ball."""
_SHRINK = 0.88
"""From step to step: all steps together are 2.7 radii long, and the last of twenty is 0.03."""
_LONGEST_CORRECTION = 1.5
"""In lengths of the step: a flat margin would otherwise ask for an endless way back."""
_TINY = 1e-12


def ascend(
    value: ValueAndGradient,
    slack: ValueAndGradient,
    start: Shaped[FloatArray, "n d"],
    centre: Shaped[FloatArray, "*c d"],
    radius: Shaped[FloatArray, " n"],
    metric: Metric,
    steps: int,
) -> tuple[Shaped[FloatArray, "n d"], Shaped[BoolArray, " n"]]:
    """Climb n functions at once, each from its own start, and keep the best safe point on each way.

    A step follows the gradient of the value, corrected so that the safety margin, taken as linear, does not
    become negative. Steps shrink geometrically.

    Args:
        value: values and gradients, (n,) and (n, p), of the functions at (n, p) kernel inputs.
        slack: values and gradients of the safety margin, which is at least 0 in the safe set; it is in
            units of prior deviations.
        start: (n, d) points of the unit cube.
        centre: (d,) centre of the ball.
        radius: (n,) radii of the balls, in kernel inputs.
        metric: from unit cube to kernel inputs.
        steps: number of steps.

    Returns:
        (n, d) best safe points, and (n,) False where no safe point was met (the start is returned there).
    """
    u = _into_ball(start, centre, radius, metric)
    best = u.copy()
    best_value = np.full(len(u), -np.inf)
    step = _FIRST_STEP * radius[:, None]
    for _ in range(steps + 1):
        inputs = metric.inputs(u)
        height, uphill = value(inputs)
        margin, inward = slack(inputs)
        safe = margin >= 0
        better = safe & (height > best_value)
        best[better], best_value[better] = u[better], height[better]
        # Only the direction of the gradient counts: its length says nothing of how far a path may be trusted.
        move = step * metric.normalised(metric.pull_back(uphill))
        u = _into_ball(u + _safe_step(move, margin, metric.pull_back(inward), metric), centre, radius, metric)
        step *= _SHRINK
    return best, np.isfinite(best_value)


def _safe_step(
    step: Shaped[FloatArray, "n d"],
    margin: Shaped[FloatArray, " n"],
    inward: Shaped[FloatArray, "n d"],
    metric: Metric,
) -> Shaped[FloatArray, "n d"]:
    """(n, d) steps, turned inwards as far as it takes for the linearised margin not to become negative.

    Args:
        step: (n, d) steps to correct.
        margin: (n,) safety margins.
        inward: (n, d) their gradients in the unit cube.
        metric: in which a correction is at most 1.5 times as long as the step.
    """
    back = metric.normalised(inward)
    rate = np.einsum("ij,ij->i", inward, back)
    short = np.maximum(-(margin + np.einsum("ij,ij->i", inward, step)), 0.0)
    length = np.minimum(short / np.maximum(rate, _TINY), _LONGEST_CORRECTION * metric.length(step)[:, 0])
    return step + length[:, None] * back


def _into_ball(
    u: Shaped[FloatArray, "n d"],
    centre: Shaped[FloatArray, "*c d"],
    radius: Shaped[FloatArray, " n"],
    metric: Metric,
) -> Shaped[FloatArray, "n d"]:
    step = u - centre
    inside = centre + step * np.minimum(1.0, radius[:, None] / np.maximum(metric.length(step), _TINY))
    return np.clip(inside, 0.0, 1.0)
