"""Search of a space of which not every point can be run, or of which some columns are not chosen.

Between steps, across choices and along linear constraints no gradient leads from one point that can be run to
the next. So points are drawn around the centre and around its neighbours (one step of one parameter, another
choice), moved to where they would be run, under the contexts of the moment, and only then judged: the safety
bound speaks of exactly what will be run. Thompson sampling chooses among those believed safe; part of a batch
takes the highest posterior means.
"""

from __future__ import annotations

import numpy as np

from hdsafebo.gp.sampling import thompson_sample
from hdsafebo.optimizers.base import Proposal
from hdsafebo.optimizers.core.empty_set import complete_batch
from hdsafebo.optimizers.local.ascents import EXPLOIT, AscentSearch
from hdsafebo.trials import Trials
from hdsafebo.typing import BoolArray, FloatArray, IntArray

_CENTRAL = 768
"""Points around the centre itself."""
_BESIDE = 768
"""Points around its neighbours, shared by all of them."""
_RADII = (0.01, 1.0)
"""Distances of points from what they are drawn around, in radii of the region, even in logarithm."""
_FEW = 3
"""Half of the points differ in at most so many columns: most of what made the centre good stays."""
_SAME = 1e-9


class PoolSearch(AscentSearch):
    """See the module."""

    def propose(self, n: int) -> Proposal:
        """The best of the pool's believed safe points, each under a posterior sample of its own."""
        optimizer, surrogate = self.optimizer, self.surrogate
        pool = self._pool(optimizer.space.pinned(self.centre()[None])[0])
        inputs = self.metric.inputs(pool)
        safe = surrogate.believed_safe(inputs, self.confidence)
        fresh = safe & ~self._tried(pool)
        rows = np.flatnonzero(
            fresh if fresh.any() else safe
        )  # noise makes a repetition worth more than nothing
        chosen = rows if len(rows) <= n else self._choose(rows, inputs, n)
        chosen = complete_batch(chosen, n, inputs, surrogate, optimizer.settings.empty_safe_set)
        return Proposal(pool[chosen], trust_region_length=self.region.length, marked_unsafe=~safe[chosen])

    def finish_round(self, trials: Trials) -> None:
        """As for ascents; under contexts that change, outcomes of two rounds do not compare."""
        region = self.region
        super().finish_round(trials)
        if self.optimizer.problem.contexts:
            self.region = region

    def _choose(self, rows: IntArray, inputs: FloatArray, n: int) -> IntArray:
        """(n,) of the rows, all different: the highest means, then Thompson samples."""
        count = int(EXPLOIT * n + self.rng.random())  # in the mean, the share of the batch
        mean = self.surrogate.objective.predict_mean(inputs[rows])
        highest = rows[np.argsort(-mean, kind="stable")[:count]]
        others = np.setdiff1d(rows, highest)
        sampled = others[thompson_sample(self.surrogate.objective, inputs[others], n - count, self.rng)]
        return np.concatenate([highest, sampled])

    def _pool(self, centre: FloatArray) -> FloatArray:
        """(k, d) different points of the unit cube that can be run, near the centre and its neighbours."""
        optimizer = self.optimizer
        space = optimizer.space
        beside = optimizer.problem.neighbours(space.to_code(centre[None])[0])
        neighbours = space.pinned(space.to_unit(beside)) if len(beside) else np.empty((0, len(centre)))
        drawn = [self._drawn(np.tile(centre, (_CENTRAL, 1)))]
        if len(neighbours):
            which = self.rng.integers(len(neighbours), size=_BESIDE)
            drawn.append(self._drawn(neighbours[which]))
        return np.unique(np.vstack([centre[None], neighbours, space.pinned(np.vstack(drawn))]), axis=0)

    def _drawn(self, around: FloatArray) -> FloatArray:
        """(k, d) one point near each of the (k, d) given ones, cut to the cube."""
        k, d = around.shape
        steps = self.rng.standard_normal((k, d))
        few = self.rng.random((k, d)) >= min(1.0, _FEW / d)
        few[np.arange(k), self.rng.integers(d, size=k)] = False
        half = np.asarray(self.rng.random((k, 1)) < 0.5)
        steps[half & few] = 0.0
        low, high = np.log(np.array(_RADII) * self.region.length * self.surrogate.length_scale)
        radius = np.exp(self.rng.uniform(low, high, (k, 1)))
        return np.clip(around + radius * self.metric.normalised(steps), 0.0, 1.0)

    def _tried(self, pool: FloatArray) -> BoolArray:
        """(k,) True for points that were run or are being run."""
        known = self.optimizer.space.to_unit(self.trials.z)
        return np.array([bool((np.abs(known - u) <= _SAME).all(axis=1).any()) for u in pool], bool)
