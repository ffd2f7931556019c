"""SCBO: constrained Thompson sampling within a trust region."""

from __future__ import annotations

import numpy as np

from hdsafebo.gp.ard import TRUST_REGION
from hdsafebo.gp.sampling import distinct_maxima
from hdsafebo.gp.surrogate import modelled_safety, modelled_thresholds
from hdsafebo.optimizers.base import Proposal
from hdsafebo.optimizers.baselines.box_region import BoxRegionOptimizer, BoxRegionSettings, improves
from hdsafebo.optimizers.settings import ModelSettings
from hdsafebo.search.candidates import box_candidates, sobol_points
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray


class ScboSettings(BoxRegionSettings, ModelSettings):
    """Settings of `scbo`: of its region, and of the surrogate that says what is believed of its trials."""


class Scbo(BoxRegionOptimizer[ScboSettings]):
    """Scalable constrained Bayesian optimisation (Eriksson and Poloczek, AISTATS 2021).

    The centre is the best feasible point of the region's history, or the one of least total violation.
    Every trial of a batch has posterior samples of its own of the objective and of all constraints at
    perturbed Sobol candidates: it takes the best candidate that its samples call feasible, or the one of
    least sampled violation. Constraints are modelled through the bilog transform, which stretches the
    surroundings of the threshold (section 3.2 there).

    What a trial carries of safety comes from the common surrogate, as for all methods; SCBO itself asks
    for no confidence.
    """

    name = "scbo"
    uses = frozenset({"latent_space", "safety"})  # a length scale for each searched coordinate
    Settings = ScboSettings

    def propose(self, n: int) -> Proposal:
        """n constrained Thompson samples in the box, or n points of the design that precedes them."""
        local = self._local()
        if len(local) < self._design_size():
            points = sobol_points(n, self.space.dimension, self.rng)
            return Proposal(points, trust_region_length=self._region.length)
        x = self.space.to_unit(local.z)
        centre = np.clip(x[self._best(local)], 0.0, 1.0)
        count = max(self.settings.candidate_count(self.space.dimension), n)
        candidates = box_candidates(centre, np.array(0.5 * self._region.length), count, self.rng)
        objective = self._warm.process("objective", x, local.objective, TRUST_REGION)
        scores = objective.paths(candidates, n, self.rng, centre)
        violation = np.zeros_like(scores)
        for j, margin in enumerate(self._margins(local).T):
            constraint = self._warm.process(f"safety{j}", x, bilog(margin), TRUST_REGION)
            violation += np.maximum(0.0, -constraint.paths(candidates, n, self.rng, centre))
        chosen = distinct_maxima(feasible_first(scores, violation))
        return Proposal(candidates[chosen], trust_region_length=self._region.length)

    def better(self, known: Trials, fresh: Trials) -> bool:
        """Whether the best of a round beats the best before: feasible before infeasible, then by value."""
        old, new = known[[self._best(known)]], fresh[[self._best(fresh)]]
        violation = float(self._violation(old)[0]), float(self._violation(new)[0])
        if violation[1] > 0:
            return violation[1] < violation[0]
        return violation[0] > 0 or improves(float(new.objective[0]), float(old.objective[0]))

    def _best(self, trials: Trials) -> int:
        """Row of the best feasible trial, or of the one with the least total violation."""
        return int(np.argmax(feasible_first(trials.objective[None], self._violation(trials)[None])[0]))

    def _violation(self, trials: Trials) -> FloatArray:
        """(n,) total violation of the modelled constraints."""
        return np.asarray(np.maximum(0.0, -self._margins(trials)).sum(axis=1))

    def _margins(self, trials: Trials) -> FloatArray:
        """(n, m) modelled safety values above their thresholds."""
        thresholds = modelled_thresholds(self.problem.safety)
        return modelled_safety(self.problem.safety, trials.safety) - thresholds


def bilog(margin: FloatArray) -> FloatArray:
    """sign(c) log(1 + |c|): steep at the threshold, flat far from it, and increasing."""
    return np.asarray(np.sign(margin) * np.log1p(np.abs(margin)))


def feasible_first(values: FloatArray, violation: FloatArray) -> FloatArray:
    """Scores that rank feasible columns by value, above all infeasible ones, which rank by least violation.

    Args:
        values: (s, k) objective values.
        violation: (s, k) total violations, 0 where feasible.
    """
    return np.where(violation > 0, values.min(axis=1, keepdims=True) - violation, values)
