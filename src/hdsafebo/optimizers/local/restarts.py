"""One climb after another: where a search by single trials goes on when it has stalled.

A trust region follows its best trial to a local optimum and stays there. With a batch, part of every round
looks elsewhere; with one trial at a time nothing does, and what is left of the budget would be spent in one
place. So a climb that stalls is over, and the next begins with a jump: from every feasible trial a posterior
sample path is climbed within the safe set, as far as a length scale from that trial, and the highest end that
is not near an earlier top is tried (Thompson sampling of where to start anew; TuRBO restarts at random).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdsafebo.gp.kernel import fast_distances
from hdsafebo.gp.sampling import SamplePaths
from hdsafebo.gp.surrogate import Surrogate
from hdsafebo.search.ascent import ascend
from hdsafebo.search.metric import Metric
from hdsafebo.search.region import IMPROVEMENT
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray, IntArray

_APART = 0.5
"""A jump ends at least so many length scales of the objective from every earlier top."""
_ARRIVED = 0.25
"""A climb that comes so close to an earlier top would end there."""
_FIRST_STEP = 0.02
_STARTS = 200


@dataclass(frozen=True)
class Climb:
    """The present climb.

    Attributes:
        first: id of its first trial; the first climb owns the initial trials too.
        tops: rows where earlier climbs have ended.
        stalled: rounds since it gained.
    """

    first: int = 0
    tops: tuple[int, ...] = ()
    stalled: int = 0

    def owns(self, trials: Trials) -> NDArray[np.bool_]:
        """(n,) True for trials of this climb."""
        return np.asarray(trials.id >= self.first)

    def after(self, gained: bool) -> Climb:
        """The climb after a round."""
        return replace(self, stalled=0 if gained else self.stalled + 1)

    def over(self, top: int, inputs: FloatArray, length_scale: float, patience: int) -> Climb | None:
        """What is known when this climb is over, its top included; None while it goes on.

        Args:
            top: row of its best trial.
            inputs: (n, p) kernel inputs of all trials.
            length_scale: of the objective.
            patience: rounds without gain after which it is over.
        """
        if self.tops:
            distance = fast_distances(inputs[[top]], inputs[list(self.tops)]).min()
            if distance < _ARRIVED * length_scale:
                return Climb(tops=self.tops)
        return Climb(tops=(*self.tops, top)) if self.stalled >= patience else None


def gain(trials: Trials, among: NDArray[np.bool_], fresh: IntArray) -> tuple[bool, bool]:
    """Whether trials improve on the best of the others, and by more than a thousandth of its size.

    Args:
        trials: all of them.
        among: (n,) True for those that count.
        fresh: ids of the trials in question.
    """
    new = np.isin(trials.id, fresh)
    best = trials.objective[among & new].max(initial=-np.inf)
    before = trials.objective[among & ~new].max(initial=-np.inf)
    if not np.isfinite(best):
        return False, False
    if not np.isfinite(before):
        return True, True
    return bool(best > before), bool(best > before + IMPROVEMENT * abs(before))


def jump(
    surrogate: Surrogate,
    starts: FloatArray,
    tops: FloatArray,
    metric: Metric,
    beta: float,
    steps: int,
    rng: np.random.Generator,
) -> FloatArray | None:
    """(1, d) first point of the next climb; None when every way up ends near an earlier top.

    Args:
        surrogate: what is believed.
        starts: (n, d) feasible points of the unit cube, the best ones first.
        tops: (k, p) kernel inputs of earlier tops.
        metric: from unit cube to kernel inputs.
        beta: of the safe set.
        steps: of an ascent.
        rng: source of randomness.
    """
    starts = starts[:_STARTS]
    paths = SamplePaths(surrogate.objective, len(starts), rng)
    radius = np.full(len(starts), surrogate.length_scale)
    direction = metric.normalised(rng.standard_normal(starts.shape))
    ends, safe = ascend(
        paths.value_and_gradient,
        lambda inputs: surrogate.slack_with_gradient(inputs, beta),
        np.clip(starts + _FIRST_STEP * radius[:, None] * direction, 0.0, 1.0),
        starts,
        radius,
        metric,
        steps,
    )
    inputs = metric.inputs(ends)
    apart = fast_distances(inputs, tops).min(axis=1) >= _APART * surrogate.objective.length_scale
    if not (safe & apart).any():
        return None
    height = np.where(safe & apart, paths.value_and_gradient(inputs)[0], -np.inf)
    return ends[[np.argmax(height)]]
