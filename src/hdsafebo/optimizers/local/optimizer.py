"""HdSafeBO with a trust region the size of the length scale, and ascent in place of candidates.

What differs from the paper's algorithm, which is kept as it is in `hdsafebo.py`:

* The trust region is a ball whose radius is a multiple rho of the fitted length scale. The box of Algorithm 1
  counts widths of the searched space; in many dimensions nearly all of it lies many length scales away from
  any data, where the posterior is the prior and the safe set means nothing. The first round probes the
  neighbourhood of the best safe point at radii spread over orders of magnitude, which tells the length scale.
* The acquisition function is maximised by gradient ascent within the safe set. Part of a batch climbs the
  posterior mean, the rest climbs posterior sample paths (Thompson sampling) close to where that leads.

Features of the problem may hide directions of the searched space: they change no kernel input, and no ascent
moves along them, though the outcomes may well depend on them. To a model such outcomes are noisy and rugged:

* Noise is taken to be large, and the objective is modelled by its normal scores.
* The centre is the weighted mean of the best feasible trials, as in an evolution strategy.
* The rest of a batch are random steps in all directions that are believed safe: of each of several classes of
  size, the best under a posterior sample of its own.

Asked for single trials in a continuous space it makes one climb after another (see `climbs`).

What the trials show to be believed too easily makes the safe set smaller (see `caution`).

On a problem with a finite candidate set the trust region is the set of rows nearest to the best safe row and
to the next best ones that lie a length scale apart (several regions at a time, as in TuRBO-m: Eriksson et
al., NeurIPS 2019), with some rows from everywhere. The safety bound then speaks of what will be evaluated, as
it does not when a point of a continuous space is replaced by its nearest row.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hdsafebo.gp.fit import NoisePrior
from hdsafebo.gp.outcomes import normal_scores
from hdsafebo.gp.sampling import SamplePaths, thompson_sample
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.core.empty_set import complete_batch
from hdsafebo.optimizers.local.caution import Caution
from hdsafebo.optimizers.local.recombination import recombined, safe_steps
from hdsafebo.optimizers.local.restarts import Climb, gain, jump
from hdsafebo.optimizers.local.row_regions import rows_near, separate_centres
from hdsafebo.optimizers.settings import OptimizerSettings
from hdsafebo.search.ascent import ascend
from hdsafebo.search.metric import Metric, kernel_metric
from hdsafebo.search.region import TrustRegion, TrustRegionRule, safe_update
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import FloatArray, IntArray

_CLOUD = 64
_PARENTS = 10
"""Trials whose mean is the centre where features hide directions."""
_HIDDEN_NOISE = NoisePrior(mode=0.1, spread=1.0, least=1 / 30, first=(0.05, 0.1, 0.4))
"""There, what the hidden directions change looks like noise; without a least value of it, small steps from a
lucky trial are believed safe that are not."""
_CENTRES = 100
_NONE = np.empty(0, np.int64)


class HdSafeBOLocalSettings(OptimizerSettings):
    """Settings of the local variant; lengths are in units of the fitted length scale unless stated.

    Attributes:
        beta: of the safe set; -2 promises a safe probability of 0.977.
        radius_initial: rho at the start.
        radius_max: largest rho.
        radius_min: smallest rho.
        success_tolerance: successful rounds after which the region grows.
        failure_tolerance: failed rounds after which it shrinks.
        exploit: share of a batch that climbs the posterior mean, at radii of 0.5 to 1.5 rho.
        explore_radius: within which the rest of the batch climbs sample paths, around the highest point
            that climbing the mean has reached: what is learnt there serves the next round.
        probe_min: smallest radius of the first round, in median distances of the initial data.
        probe_max: largest one.
        steps: of an ascent.
        caution: by how much beta is lowered for each violation beyond the promised number of them, in a
            continuous space; 0 leaves it as it is.
        parents_from: where features hide directions, the number of last trials whose best are the centre's
            parents, so that old ones, best by luck, do not hold it back; None takes all trials.
        least_step: there, least size of a random step in units of the largest that is believed safe. Small
            ones win most often, by least: the parents become copies of each other.
        patience: single trials in a continuous space without gain after which a climb is over.
        jump_beta: of the safe set in which the next climb begins; None takes `beta`. A larger one finds more
            optima; first trials that `beta` alone would have refused are marked.
        regions: on a finite candidate set, the most trust regions at a time; they share its rows equally.
        rows_initial: size of the trust regions together, in rows of a finite candidate set.
        rows_max: largest size.
        rows_min: smallest size.
        rows_elsewhere: rows drawn from the whole candidate set each round.
    """

    beta: float = -2.0
    radius_initial: float = Field(default=0.5, gt=0)
    radius_max: float = Field(default=1.0, gt=0)
    radius_min: float = Field(default=0.02, gt=0)
    success_tolerance: int = Field(default=2, ge=1)
    failure_tolerance: int = Field(default=3, ge=1)
    exploit: float = Field(default=0.2, ge=0, le=1)
    explore_radius: float = Field(default=0.2, gt=0)
    probe_min: float = Field(default=1e-3, gt=0)
    probe_max: float = Field(default=2e-2, gt=0)
    steps: int = Field(default=20, ge=1)
    caution: float = Field(default=3.0, ge=0)
    parents_from: int | None = Field(default=None, ge=1)
    least_step: float = Field(default=0.0, ge=0, le=1)
    patience: int = Field(default=8, ge=1)
    jump_beta: float | None = None
    regions: int = Field(default=4, ge=1)
    rows_initial: int = Field(default=4000, ge=1)
    rows_max: int = Field(default=16000, ge=1)
    rows_min: int = Field(default=500, ge=1)
    rows_elsewhere: int = Field(default=2000, ge=0)


class HdSafeBOLocal(Optimizer):
    """Local variant of HdSafeBO."""

    name = "hdsafebo_local"
    Settings = HdSafeBOLocalSettings
    settings: HdSafeBOLocalSettings
    uses = Optimizer.uses | {"candidate_rows"}

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        s = self.settings
        tolerances = (s.success_tolerance, s.failure_tolerance)
        if self.problem.candidates is None:
            self._rule = TrustRegionRule(
                s.radius_initial, s.radius_min, s.radius_max, *tolerances, factor=1.5, restart=False
            )
        else:
            self._rule = TrustRegionRule(s.rows_initial, s.rows_min, s.rows_max, *tolerances)
        self.region = TrustRegion(self._rule.initial)
        self.caution = Caution()
        self.climb = Climb()
        self._metric: Metric | None = None

    def propose(self, n: int) -> Proposal:
        """A probe in the first round, then ascents; on a finite set, rows of the trust region.

        Where features hide directions: some ascents of the mean, and random steps.
        """
        if self.problem.candidates is not None:
            return self._choose_rows(n)
        if n == 1 and (first := self._next_climb()) is not None:
            return first
        centre = self._centre()
        if self.round == 0 and n > 1 and not self.hides_directions:
            return self._believed(self._probe(centre, n), centre, n)
        climbers = self._exploit(centre, n)
        count = int(self.settings.exploit * n + self.rng.random())  # in the mean, the share of the batch
        if self.hides_directions:
            beta, least = self.confidence, self.settings.least_step
            explorers = safe_steps(self.surrogate, self.metric, centre, beta, n - count, self.rng, least)
        else:
            predicted = self.surrogate.objective.predict_mean(self.metric.inputs(climbers))
            explorers = self._explore(climbers[predicted.argmax()], n - count)
        return self._believed(np.concatenate([climbers[:count], explorers]), centre, n)

    def centre_row(self) -> int:
        """Row of the climb's best feasible trial among those believed safe, or of Algorithm 1's x*.

        Around a trial that was safe by luck or by less than the noise, little is believed safe.
        """
        rows = self._best_first(self.feasible & self.climb.owns(self.trials))[:_CENTRES]
        if len(rows):
            inputs = self.kernel_inputs(self.trials[rows])
            believed = rows[self.surrogate.believed_safe(inputs, self.confidence)]
            if len(believed) or self.climb.first > 0:
                return int(believed[0] if len(believed) else rows[0])
        return super().centre_row()

    def _best_first(self, which: NDArray[np.bool_]) -> IntArray:
        """Rows where `which` is True, the highest objective first."""
        rows = np.flatnonzero(which)
        return rows[np.argsort(-self.trials.objective[rows], kind="stable")]

    @property
    def confidence(self) -> float:
        """The beta of the safe set: the given one, lowered where it promised too much."""
        return self.caution.corrected(self.settings.confidence, self.settings.caution)

    def finish_round(self, trials: Trials) -> None:
        """A round succeeds when it improves on the climb's best feasible objective; violations lower beta."""
        own = self.feasible & self.climb.owns(self.trials)
        improved, gained = gain(self.trials, own, trials.id)
        self.region = safe_update(self.region, improved, self._rule)
        self.climb = self.climb.after(gained)
        promised = trials.completed & ~trials.marked_unsafe
        if self.problem.candidates is None:
            violations = int((promised & ~self.feasible[trials.id]).sum())
            self.caution = self.caution.after(violations, int(promised.sum()), self.settings.confidence)

    # --- continuous space

    @property
    def hides_directions(self) -> bool:
        """Whether some directions of the continuous space change no kernel input."""
        return self.problem.candidates is None and self.metric.hides_directions

    @property
    def noise_prior(self) -> NoisePrior:
        """A larger one where features hide directions."""
        return _HIDDEN_NOISE if self.hides_directions else super().noise_prior

    def outcomes_to_fit(self, rows: IntArray) -> FloatArray:
        """Objective values, or their normal scores where features hide directions."""
        values = super().outcomes_to_fit(rows)
        return normal_scores(values) if self.hides_directions else values

    def _centre(self) -> FloatArray:
        """(d,) the point of `centre_row`, or the mean of `_parents` where features hide directions."""
        parents = self._parents() if self.hides_directions else _NONE
        if len(parents):
            return recombined(np.clip(self.space.to_unit(self.trials.z[parents]), 0.0, 1.0))
        return np.clip(self.space.to_unit(self.trials.z[[self.centre_row()]])[0], 0.0, 1.0)

    def _parents(self) -> IntArray:
        """Rows of the best feasible of the last trials; of all, while there are few that were asked for."""
        own = self.feasible & self.climb.owns(self.trials)
        last = self.settings.parents_from
        if last is not None and (~self.trials.initial).sum() >= last:
            recent = own & (self.trials.id >= len(self.trials) - last)
            own = recent if recent.sum() >= _PARENTS else own
        return self._best_first(own)[:_PARENTS]

    def _probe(self, centre: FloatArray, n: int) -> FloatArray:
        """Points around the centre at radii spread evenly over orders of magnitude."""
        radii = np.geomspace(self.settings.probe_min, self.settings.probe_max, n)
        return self._around(centre, radii * self.surrogate.objective.hyper.reference)

    def _exploit(self, centre: FloatArray, n: int) -> FloatArray:
        """Ascents of the posterior mean at several radii, at least one."""
        count = max(1, ceil(self.settings.exploit * n))
        spread = np.linspace(0.5, 1.5, count) if count > 1 else np.ones(1)
        radius = spread * self.region.length * self.surrogate.length_scale
        return self._climb(self._mean_value, centre, radius)

    def _explore(self, centre: FloatArray, n: int) -> FloatArray:
        """Ascents of independent sample paths."""
        if n == 0:
            return np.empty((0, len(centre)))
        paths = SamplePaths(self.surrogate.objective, n, self.rng)
        radius = self.settings.explore_radius * self.surrogate.length_scale
        return self._climb(paths.value_and_gradient, centre, np.full(n, radius))

    def _next_climb(self) -> Proposal | None:
        """The trial that begins the next climb; None while the present one goes on, or when there is none."""
        if len(self.trials) == 0 or not self.feasible.any():
            return None
        own = self.trials[self.climb.owns(self.trials)]
        begun = self.feasible[own.id].any() or (own.status == Status.PENDING).any()
        inputs = self.kernel_inputs(self.trials)
        known: Climb | None = Climb(tops=self.climb.tops)
        if begun:
            scale = self.surrogate.objective.length_scale
            known = self.climb.over(self.centre_row(), inputs, scale, self.settings.patience)
        if known is None:
            return None
        rows = self._best_first(self.feasible)
        starts = np.clip(self.space.to_unit(self.trials.z[rows]), 0.0, 1.0)
        beta = self.confidence if self.settings.jump_beta is None else self.settings.jump_beta
        steps = self.settings.steps
        point = jump(self.surrogate, starts, inputs[list(known.tops)], self.metric, beta, steps, self.rng)
        if point is None:
            self.climb = known  # a round around the best trial of all, then another sample path
            return None
        believed = self.surrogate.believed_safe(self.metric.inputs(point), self.confidence)
        self.climb = replace(known, first=len(self.trials))
        self.region = TrustRegion(self._rule.initial)
        return Proposal(point, marked_unsafe=~believed)

    def _mean_value(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        mean, _, gradient, _ = self.surrogate.objective.predict_with_gradient(inputs)
        return mean, gradient

    def _climb(self, value: Any, centre: FloatArray, radius: FloatArray) -> FloatArray:
        start = self._around(centre, 0.02 * radius)
        points, _ = ascend(
            value,
            lambda inputs: self.surrogate.slack_with_gradient(inputs, self.confidence),
            start,
            centre,
            radius,
            self.metric,
            self.settings.steps,
        )
        return points

    def _around(self, centre: FloatArray, radius: FloatArray) -> FloatArray:
        """(k, d) points at the (k,) radii from the centre in random directions, cut to the cube."""
        direction = self.metric.normalised(self.rng.standard_normal((len(radius), len(centre))))
        return np.clip(centre + radius[:, None] * direction, 0.0, 1.0)

    def _believed(self, points: FloatArray, centre: FloatArray, n: int) -> Proposal:
        """The points, at most n, that are believed safe; for each other one, one close to the centre."""
        reach = self.settings.explore_radius * self.surrogate.length_scale
        cloud = self._around(centre, reach * np.geomspace(1e-3, 1.0, _CLOUD))
        candidates = np.concatenate([points, cloud])
        inputs = self.metric.inputs(candidates)
        safe = self.surrogate.believed_safe(inputs, self.confidence)
        chosen = complete_batch(
            np.flatnonzero(safe)[:n], n, inputs, self.surrogate, self.settings.empty_safe_set
        )
        return Proposal(
            candidates[chosen], trust_region_length=self.region.length, marked_unsafe=~safe[chosen]
        )

    @property
    def metric(self) -> Metric:
        """From the unit cube to kernel inputs; ProblemError where that is no affine map."""
        if self._metric is None:
            self._metric = kernel_metric(self.problem, self.embedding, self.space)
        return self._metric

    # --- finite candidate set

    def _choose_rows(self, n: int) -> Proposal:
        """Thompson sampling over the believed safe rows of the trust regions and some from elsewhere."""
        features = self.problem.candidates.features  # type: ignore[union-attr]
        left = np.setdiff1d(np.arange(len(features)), self.taken, assume_unique=True)
        centres = self._centres()
        share = max(1, self.settings.rows_initial // len(centres))
        size = min(max(1, int(self.region.length) // len(centres)), len(left))
        near = rows_near(features, self.taken, centres, size, share, self.rng)
        elsewhere = self.rng.choice(left, min(self.settings.rows_elsewhere, len(left)), replace=False)
        rows = np.unique(np.concatenate([*near, elsewhere]))
        inputs = features[rows]
        safe = self.surrogate.believed_safe(inputs, self.settings.confidence)
        chosen = np.flatnonzero(safe)
        if len(chosen) > n:
            chosen = chosen[thompson_sample(self.surrogate.objective, inputs[chosen], n, self.rng)]
        chosen = complete_batch(chosen, n, inputs, self.surrogate, self.settings.empty_safe_set)
        return Proposal(
            rows=rows[chosen], trust_region_length=self.region.length, marked_unsafe=~safe[chosen]
        )

    def _centres(self) -> FloatArray:
        """(k, p) the best trial, then the next best believed safe ones a length scale apart."""
        rows = self._best_first(self.feasible)[:_CENTRES]
        inputs = self.kernel_inputs(self.trials[rows])
        inputs = inputs[self.surrogate.believed_safe(inputs, self.settings.confidence)]
        best = self.kernel_inputs(self.trials[[self.centre_row()]])
        return separate_centres(best, inputs, self.surrogate.objective.length_scale, self.settings.regions)

    def kernel_inputs(self, trials: Trials) -> FloatArray:
        """Features of the candidates, the problem's features of the inputs, or the code's own metric."""
        candidates = self.problem.candidates
        if candidates is None:
            if self.problem.features is None:
                return super().kernel_inputs(trials)
            return np.asarray(self.problem.features(trials.x), float)
        rows = trials.candidate.copy()
        foreign = rows < 0  # inputs outside the set count as their nearest row
        if foreign.any():
            rows[foreign] = np.concatenate([candidates.nearest(x[None], _NONE) for x in trials.x[foreign]])
        return candidates.features[rows]

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Length and counters of the trust region, the violations in excess, and the climb."""
        return asdict(self.region) | asdict(self.caution) | asdict(self.climb), {}

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `method_state` gave."""
        self.caution = Caution(state["excess"])
        self.region = TrustRegion(state["length"], state["successes"], state["failures"])
        self.climb = Climb(state["first"], tuple(state["tops"]), state["stalled"])
