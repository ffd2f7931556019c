"""Search where features hide directions of the space: they change no kernel input, yet may change outcomes.

No ascent moves along such directions, and to a model what they do looks like noise on rugged outcomes:

* Noise is taken to be large, and the objective is modelled by its normal scores.
* The centre is the weighted mean of the best feasible trials, as in an evolution strategy.
* Beside some ascents of the mean, a batch consists of random steps in all directions that are believed safe:
  of each of several classes of size, the best under a posterior sample of its own.

In thousands of dimensions a mean of all good trials hardly moves and small steps change little, so the
parents are recent ones, the steps large, and a violation, which large steps make likelier, lowers beta by
less.
"""

from __future__ import annotations

import numpy as np

from hdsafebo.gp.fit import NoisePrior
from hdsafebo.gp.outcomes import normal_scores
from hdsafebo.optimizers.base import Proposal
from hdsafebo.optimizers.local.ascents import EXPLOIT, AscentSearch
from hdsafebo.optimizers.local.base import SearchingOptimizer
from hdsafebo.optimizers.local.recombination import recombined, safe_steps
from hdsafebo.search.ascent import Metric
from hdsafebo.typing import FloatArray, IntArray

_PARENTS = 10
"""Trials whose mean is the centre."""
_MANY = 1000
"""Dimensions from which parents are recent and steps large: measured are 325 (no) and 3,575 (yes)."""
_RECENT = 30
"""Trials among whose best the parents are then chosen: old ones, best by luck, would hold the mean back."""
_LEAST_STEP = 0.3
"""Least size of a step then, in units of the largest that is believed safe. Small steps win most often, by
least: the parents become copies of each other."""
_RATE = 0.5
"""Of caution then."""


class HiddenSearch(AscentSearch):
    """See the module."""

    # What the hidden directions change looks like noise; without a least value of it, small steps from a
    # lucky trial are believed safe that are not.
    noise_prior = NoisePrior(mode=0.1, spread=1.0, least=1 / 30, first=(0.05, 0.1, 0.4))

    def __init__(self, optimizer: SearchingOptimizer, metric: Metric) -> None:
        super().__init__(optimizer, metric)
        self._many = optimizer.space.dimension >= _MANY
        if self._many:
            self.rate = _RATE

    def propose(self, n: int) -> Proposal:
        """Some ascents of the mean, and random steps."""
        centre = self.centre()
        climbers = self._climb_mean(centre, n)
        count = int(EXPLOIT * n + self.rng.random())
        least = _LEAST_STEP if self._many else 0.0
        steps = safe_steps(self.surrogate, self.metric, centre, self.confidence, n - count, self.rng, least)
        return self._believed(np.concatenate([climbers[:count], steps]), centre, n)

    def targets(self, rows: IntArray) -> FloatArray:
        """Normal scores of the objective values."""
        return normal_scores(super().targets(rows))

    def centre(self) -> FloatArray:
        """(d,) weighted mean of the parents; without any, the point of the optimiser's centre row."""
        parents = self._parents()
        if len(parents) == 0:
            return super().centre()
        codes = self.trials.z[parents]
        return recombined(np.clip(self.optimizer.space.to_unit(codes), 0.0, 1.0))

    def _parents(self) -> IntArray:
        """Rows of the best feasible trials; in many dimensions of the recent ones, once enough were asked."""
        own, trials = self.own, self.trials
        if self._many and (~trials.initial).sum() >= _RECENT:
            recent = own & (trials.id >= len(trials) - _RECENT)
            own = recent if recent.sum() >= _PARENTS else own
        return self.best_first(own)[:_PARENTS]
