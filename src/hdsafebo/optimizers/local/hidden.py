"""Search where features hide directions of the space: they change no kernel input, yet may change outcomes.

No ascent moves along such directions, and to a model what they do looks like noise on rugged outcomes:

* Noise is taken to be large, and the objective is modelled by its normal scores.
* The centre is the weighted mean of the best feasible trials, as in an evolution strategy.
* Beside some ascents of the mean, a batch consists of random steps in all directions that are believed safe:
  of each of several classes of size, the best under a posterior sample of its own.

In thousands of dimensions a mean of all good trials hardly moves and small steps change little, so the
parents are recent ones, the steps large, and a violation, which large steps make likelier, lowers beta by
less. Steps and ascents are computed in what kernel inputs see of them (see `row_space`).
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import NoSafePointError
from hdsafebo.gp.fit import NoisePrior
from hdsafebo.gp.outcomes import normal_scores
from hdsafebo.optimizers.base import Proposal
from hdsafebo.optimizers.local.ascents import EXPLOIT, FIRST_STEP, STEPS, AscentSearch
from hdsafebo.optimizers.local.base import SearchingOptimizer
from hdsafebo.optimizers.local.recombination import recombined, safe_steps
from hdsafebo.search.ascent import ValueAndGradient, ascend
from hdsafebo.search.metric import Metric
from hdsafebo.search.row_space import RowSpace
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray, IntArray

_PARENTS = 10
"""Trials whose mean is the centre."""
_NEAR = 0.5
"""Length scales within which parents are close to the best: there the model knows what their mean does."""
_MANY = 1000
"""Dimensions from which parents are recent and steps large: measured are 325 (no) and 3,575 (yes)."""
_RECENT = 30
"""Trials among whose best the parents are then chosen: old ones, best by luck, would hold the mean back."""
_LEAST_STEP = 0.3
"""Least size of a step then, in units of the largest that is believed safe. Small steps win most often, by
least: the parents become copies of each other."""
_RATE = 0.5
"""Of caution then."""
_GROWTH = 0.03
"""Share by which the trials grow between two searches for hyper-parameters then: a fit to a thousand trials
takes most of a round, and ten more tell it nothing new."""


class HiddenSearch(AscentSearch):
    """See the module."""

    # What the hidden directions change looks like noise; without a least value of it, small steps from a
    # lucky trial are believed safe that are not.
    noise_prior = NoisePrior(mode=0.1, spread=1.0, least=1 / 30, first=(0.05, 0.1, 0.4))

    def __init__(self, optimizer: SearchingOptimizer, metric: Metric) -> None:
        super().__init__(optimizer, metric)
        self.rows = RowSpace.of(metric)
        self.lost = False
        self._many = optimizer.space.dimension >= _MANY
        if self._many:
            self.rate = _RATE

    def propose(self, n: int) -> Proposal:
        """Some ascents of the mean, and random steps, from the first centre with steps believed safe."""
        count = int(EXPLOIT * n + self.rng.random())
        for centre in self._centres():
            steps = self._steps(centre, n - count)
            if len(steps) or count == n:
                climbers = self._climb_mean(centre, n)[:count]
                return self._believed(np.concatenate([climbers, steps]), centre, n)
        return self._nothing_safe(centre, n)

    def finish_round(self, trials: Trials) -> None:
        """Whether trials can still be marked depends on how marked ones ended."""
        super().finish_round(trials)
        feasible = self.optimizer.feasible[trials.id]
        self.lost = bool(trials.marked_unsafe.all() and not feasible.any())

    def refines(self) -> bool:
        """In many dimensions, only where the trials have grown; which is known from the trials alone."""
        if not self._many:
            return True
        trials = self.trials
        before = int((trials.completed & (trials.round < trials.round.max(initial=0))).sum())
        return _stage_of(before) < _stage_of(int(trials.completed.sum()))

    def targets(self, rows: IntArray) -> FloatArray:
        """Normal scores of the objective values."""
        return normal_scores(super().targets(rows))

    def centre(self) -> FloatArray:
        """(d,) weighted mean of the parents; without any, the point of the optimiser's centre row."""
        return next(self._centres())

    def state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """With whether the last round was lost."""
        state, arrays = super().state()
        return state | {"lost": self.lost}, arrays

    def restore(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `state` gave."""
        super().restore(state, arrays)
        self.lost = state["lost"]

    def _centres(self) -> Iterator[FloatArray]:
        """Means of all parents and of those close to the best, then the best trial that is believed safe.

        Policies that are far apart may each be safe and their mean not.
        """
        parents = self._parents()
        if len(parents):
            yield self._mean_of(parents)
            inputs = self.optimizer.inputs_of(parents)
            distance = np.linalg.norm(inputs - inputs[0], axis=1)
            near = parents[distance <= _NEAR * self.surrogate.length_scale]
            if len(near) < len(parents):
                yield self._mean_of(near)
        yield super().centre()

    def _mean_of(self, parents: IntArray) -> FloatArray:
        codes = self.trials.z[parents]
        return recombined(np.clip(self.optimizer.space.to_unit(codes), 0.0, 1.0))

    def _parents(self) -> IntArray:
        """Rows of the best feasible trials; in many dimensions of the recent ones, once enough were asked."""
        own, trials = self.own, self.trials
        if self._many and (~trials.initial).sum() >= _RECENT:
            recent = own & (trials.id >= len(trials) - _RECENT)
            own = recent if recent.sum() >= _PARENTS else own
        return self.best_first(own)[:_PARENTS]

    def _steps(self, centre: FloatArray, n: int) -> FloatArray:
        """(m, d) ends of random steps that are believed safe, m at most n."""
        least = _LEAST_STEP if self._many else 0.0
        arguments = (self.surrogate, self.metric, self.rows, centre, self.confidence, n, self.rng)
        return safe_steps(*arguments, least=least, whole=not self._many)

    def _climb(self, value: ValueAndGradient, centre: FloatArray, radius: FloatArray) -> FloatArray:
        """In many dimensions, ascents in the numbers that kernel inputs see; nothing hidden moves."""
        if not self._many:
            return super()._climb(value, centre, radius)
        beta, surrogate = self.confidence, self.surrogate
        metric, middle = self.rows.around(self.metric.inputs(centre[None])[0])
        directions = metric.normalised(self.rng.standard_normal((len(radius), self.rows.rank)))
        points, _ = ascend(
            value,
            lambda inputs: surrogate.slack_with_gradient(inputs, beta),
            middle + FIRST_STEP * radius[:, None] * directions,
            middle,
            radius,
            metric,
            STEPS,
        )
        return np.clip(centre + self.rows.lifted(points), 0.0, 1.0)

    def _believed(self, points: FloatArray, centre: FloatArray, n: int) -> Proposal:
        """As ever; without the cloud, which costs as much as all else here, where enough points are safe."""
        safe = self.surrogate.believed_safe(self.metric.inputs(points), self.confidence)
        if safe.sum() < n:
            return super()._believed(points, centre, n)
        return Proposal(points[safe][:n], trust_region_length=self.region.length)

    def _nothing_safe(self, centre: FloatArray, n: int) -> Proposal:
        """Points close to the best trial, marked where they are not believed safe.

        Raises:
            NoSafePointError: the last round was marked, too, and nothing in it was safe.
        """
        if self.lost:
            raise NoSafePointError(
                "no step from any of the best trials is believed safe, and the last round, which was marked, "
                "was unsafe altogether; report more trials near a safe one, or choose a larger beta"
            )
        return self._believed(np.empty((0, len(centre))), centre, n)


def _stage_of(trials: int) -> int:
    """Number of times that so many trials have grown by 3 %; below 34, every trial counts."""
    first = ceil(1 / _GROWTH)
    return trials if trials < first else first + int(np.log(trials / first) / np.log1p(_GROWTH))
