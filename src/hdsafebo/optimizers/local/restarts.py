"""One climb after another: where a search by single trials goes on when it has stalled.

A trust region follows its best trial to a local optimum and stays there. With a batch, part of every round
looks elsewhere; with one trial at a time nothing does, and what is left of the budget would be spent in one
place. So a climb that stalls is over, and the next begins with a jump: from every feasible trial a posterior
sample path is climbed within the safe set, as far as a length scale from that trial, and the highest end that
is not near an earlier top is tried (Thompson sampling of where to start anew; TuRBO restarts at random).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hdsafebo.gp.kernel import fast_distances
from hdsafebo.gp.sampling import SamplePaths
from hdsafebo.gp.surrogate import Surrogate
from hdsafebo.optimizers.base import Proposal
from hdsafebo.optimizers.local.ascents import STEPS, AscentSearch
from hdsafebo.optimizers.local.base import gain
from hdsafebo.optimizers.local.settings import RestartSettings
from hdsafebo.search.ascent import Metric, ascend
from hdsafebo.search.region import TrustRegion
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import FloatArray

_APART = 0.5
"""A jump ends at least so many length scales of the objective from every earlier top."""
_ARRIVED = 0.25
"""A climb that comes so close to an earlier top would end there."""
_FIRST_STEP = 0.02
"""In length scales, off a start that the radius is counted from: at its centre a radius has no direction."""
_STARTS = 200
"""Best points of a pool that ascents of a jump begin from, all at once."""
PATIENCE = 8
"""Rounds without gain after which a climb is over."""


class Restarts:
    """Climbs of a search, one after another.

    Args:
        search: whose climbs they are; where one begins is its `since`.
        settings: of restarts.

    Attributes:
        tops: rows where earlier climbs have ended.
        stalled: rounds since the present one gained.
    """

    def __init__(self, search: AscentSearch, settings: RestartSettings) -> None:
        self.search = search
        self._settings = settings
        self.tops: tuple[int, ...] = ()
        self.stalled = 0

    def finish_round(self, trials: Trials) -> None:
        """Count rounds without gain."""
        search = self.search
        _, gained = gain(search.trials, search.own, trials.id)
        self.stalled = 0 if gained else self.stalled + 1

    def first_of_next(self) -> Proposal | None:
        """The trial that begins the next climb; None while the present one goes on, or when there is none."""
        search, optimizer = self.search, self.search.optimizer
        if len(search.trials) == 0 or not optimizer.feasible.any():
            return None
        inputs = search.optimizer.inputs_of(np.arange(len(search.trials)))
        over, tops = self._over(inputs)
        if not over:
            return None
        rows = search.best_first(optimizer.feasible)
        starts = np.clip(optimizer.space.to_unit(search.trials.z[rows]), 0.0, 1.0)
        point = jump(search.surrogate, starts, inputs[list(tops)], search.metric, self._beta, search.rng)
        self.tops, self.stalled = tops, 0
        if point is None:
            search.since = 0  # a round around the best trial of all, then another sample path
            return None
        believed = search.surrogate.believed_safe(search.metric.inputs(point), search.confidence)
        search.since = len(search.trials)
        search.region = TrustRegion(search.rule.initial)
        return Proposal(point, marked_unsafe=~believed)

    def state(self) -> dict[str, Any]:
        """Plain data."""
        return {"tops": self.tops, "stalled": self.stalled}

    def restore(self, state: dict[str, Any]) -> None:
        """Take back what `state` gave."""
        self.tops, self.stalled = tuple(state["tops"]), state["stalled"]

    @property
    def _beta(self) -> float:
        """Of the safe set in which the next climb begins."""
        return self.search.confidence if self._settings.beta is None else self._settings.beta

    def _over(self, inputs: FloatArray) -> tuple[bool, tuple[int, ...]]:
        """Whether the present climb is over, and the tops known then, its own included.

        It is over when it has stalled, when it comes close to an earlier top, or when its first trial gave
        nothing to go on from.

        Args:
            inputs: (n, p) kernel inputs of all trials.
        """
        search, optimizer = self.search, self.search.optimizer
        own = search.trials.id >= search.since
        pending = search.trials.status == Status.PENDING
        if not (own & (optimizer.feasible | pending)).any():
            return True, self.tops
        top = optimizer.centre_row()
        if self.tops:
            distance = fast_distances(inputs[[top]], inputs[list(self.tops)]).min()
            if distance < _ARRIVED * search.surrogate.objective.length_scale:
                return True, self.tops
        return (True, (*self.tops, top)) if self.stalled >= PATIENCE else (False, self.tops)


def jump(
    surrogate: Surrogate,
    starts: FloatArray,
    tops: FloatArray,
    metric: Metric,
    beta: float,
    rng: np.random.Generator,
) -> FloatArray | None:
    """(1, d) first point of the next climb; None when every way up ends near an earlier top.

    Args:
        surrogate: what is believed.
        starts: (n, d) feasible points of the unit cube, the best ones first.
        tops: (k, p) kernel inputs of earlier tops.
        metric: from unit cube to kernel inputs.
        beta: of the safe set.
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
        STEPS,
    )
    inputs = metric.inputs(ends)
    apart = fast_distances(inputs, tops).min(axis=1) >= _APART * surrogate.objective.length_scale
    if not (safe & apart).any():
        return None
    height = np.where(safe & apart, paths.value_and_gradient(inputs)[0], -np.inf)
    return ends[[np.argmax(height)]]
