"""Search of a continuous space by ascents of an isotropic model, within the safe set and a ball.

The trust region is a ball whose radius is a multiple rho of the fitted length scale. The box of Algorithm 1
counts widths of the searched space; in many dimensions nearly all of it lies many length scales away from
any data, where the posterior is the prior and the safe set means nothing. The first round probes the
neighbourhood of the best safe point at radii spread over orders of magnitude, which tells the length scale.

The acquisition function is maximised by gradient ascent. Part of a batch climbs the posterior mean, the rest
climbs posterior sample paths (Thompson sampling) close to where that leads: what is learnt there serves the
next round. What the trials show to be believed too easily makes the safe set smaller (see `caution`).
"""

from __future__ import annotations

from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdsafebo.gp.sampling import SamplePaths
from hdsafebo.optimizers.base import Proposal
from hdsafebo.optimizers.core.empty_set import complete_batch
from hdsafebo.optimizers.local.base import RegionSearch, SearchingOptimizer
from hdsafebo.optimizers.local.caution import Caution
from hdsafebo.search.ascent import Metric, ValueAndGradient, ascend
from hdsafebo.search.region import TrustRegionRule
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray

STEPS = 20
"""Of an ascent."""
EXPLOIT = 0.2
"""Share of a batch that climbs the posterior mean."""
_SPREAD = (0.5, 1.5)
"""Radii of those ascents, in radii of the region: their ends differ though their top is the same."""
EXPLORE_RADIUS = 0.2
"""Length scales within which the rest of a batch climbs sample paths."""
_PROBES = (1e-3, 2e-2)
"""Radii of the first round, in median distances of the initial data."""
_CLOUD = 64
"""Random points close to the centre that fill up a batch, should ascents end outside the safe set."""
FIRST_STEP = 0.02
"""Where an ascent starts, in its radii: at the centre itself a gradient may vanish."""


class AscentSearch(RegionSearch):
    """See the module.

    Args:
        optimizer: see `RegionSearch`.
        metric: from the unit cube to kernel inputs.

    Attributes:
        caution: violations beyond the promised number.
        rate: by how much each of them lowers beta.
    """

    # Lengths in fitted length scales: within half of one the model knows the function well.
    rule = TrustRegionRule(
        initial=0.5, least=0.02, most=1.0, successes=2, failures=3, factor=1.5, restart=False
    )
    rate = 3.0

    def __init__(self, optimizer: SearchingOptimizer, metric: Metric) -> None:
        super().__init__(optimizer)
        self.metric = metric
        self.caution = Caution()

    def propose(self, n: int) -> Proposal:
        """Ascents of the mean, then of sample paths around the highest of their ends."""
        centre = self.centre()
        if self.optimizer.round == 0 and n > 1:
            return self._believed(self._probe(centre, n), centre, n)
        climbers = self._climb_mean(centre, n)
        count = int(EXPLOIT * n + self.rng.random())  # in the mean, the share of the batch
        predicted = self.surrogate.objective.predict_mean(self.metric.inputs(climbers))
        explorers = self._climb_paths(climbers[predicted.argmax()], n - count)
        return self._believed(np.concatenate([climbers[:count], explorers]), centre, n)

    def finish_round(self, trials: Trials) -> None:
        """Violations lower beta."""
        super().finish_round(trials)
        promised = trials.completed & ~trials.marked_unsafe
        violations = int((promised & ~self.optimizer.feasible[trials.id]).sum())
        beta = self.optimizer.settings.confidence
        self.caution = self.caution.after(violations, int(promised.sum()), beta)

    @property
    def confidence(self) -> float:
        """The given beta, lowered where it promised too much."""
        return self.caution.corrected(self.optimizer.promised_beta, self.rate)

    def centre(self) -> FloatArray:
        """(d,) where the ascents start: the point of the optimiser's centre row."""
        row = self.optimizer.centre_row()
        return np.asarray(np.clip(self.optimizer.space.to_unit(self.trials.z[[row]])[0], 0.0, 1.0))

    def state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """With the violations in excess."""
        state, arrays = super().state()
        return state | {"excess": self.caution.excess}, arrays

    def restore(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `state` gave."""
        super().restore(state, arrays)
        self.caution = Caution(state["excess"])

    def _probe(self, centre: FloatArray, n: int) -> FloatArray:
        """(n, d) points around the centre at radii spread evenly over orders of magnitude."""
        radii = np.geomspace(*_PROBES, n)
        return self._around(centre, radii * self.surrogate.objective.hyper.reference)

    def _climb_mean(self, centre: FloatArray, n: int) -> FloatArray:
        """(k, d) ends of ascents of the posterior mean at several radii, at least one."""
        count = max(1, ceil(EXPLOIT * n))
        spread = np.linspace(*_SPREAD, count) if count > 1 else np.ones(1)
        radius = spread * self.region.length * self.surrogate.length_scale
        return self._climb(self._mean, centre, radius)

    def _climb_paths(self, centre: FloatArray, n: int) -> FloatArray:
        """(n, d) ends of ascents of independent sample paths."""
        if n == 0:
            return np.empty((0, len(centre)))
        surrogate = self.surrogate
        paths = SamplePaths(surrogate.objective, n, self.rng)
        radius = np.full(n, EXPLORE_RADIUS * surrogate.length_scale)
        return self._climb(paths.value_and_gradient, centre, radius)

    def _mean(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        mean, _, gradient, _ = self.surrogate.objective.predict_with_gradient(inputs)
        return mean, gradient

    def _climb(self, value: ValueAndGradient, centre: FloatArray, radius: FloatArray) -> FloatArray:
        beta, surrogate = self.confidence, self.surrogate
        points, _ = ascend(
            value,
            lambda inputs: surrogate.slack_with_gradient(inputs, beta),
            self._around(centre, FIRST_STEP * radius),
            centre,
            radius,
            self.metric,
            STEPS,
        )
        return points

    def _around(self, centre: FloatArray, radius: FloatArray) -> FloatArray:
        """(k, d) points at the (k,) radii from the centre in random directions, cut to the cube."""
        steps = self.rng.standard_normal((len(radius), len(centre)))
        direction = self.metric.normalised(steps)
        return np.clip(centre + radius[:, None] * direction, 0.0, 1.0)

    def _believed(self, points: FloatArray, centre: FloatArray, n: int) -> Proposal:
        """The points, at most n, that are believed safe; for each other one, one close to the centre."""
        surrogate, policy = self.surrogate, self.optimizer.settings.empty_safe_set
        reach = EXPLORE_RADIUS * surrogate.length_scale
        cloud = self._around(centre, reach * np.geomspace(1e-3, 1.0, _CLOUD))
        candidates = np.concatenate([points, cloud])
        inputs = self.metric.inputs(candidates)
        safe = surrogate.believed_safe(inputs, self.confidence)
        chosen = complete_batch(np.flatnonzero(safe)[:n], n, inputs, surrogate, policy)
        return Proposal(
            candidates[chosen], trust_region_length=self.region.length, marked_unsafe=~safe[chosen]
        )
