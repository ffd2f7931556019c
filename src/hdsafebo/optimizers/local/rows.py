"""Search of a finite candidate set: Thompson sampling over the rows of several trust regions.

The regions are the rows nearest to the best safe row and to the next best ones that lie a length scale apart
(as in TuRBO-m: Eriksson et al., NeurIPS 2019); some rows from everywhere join them. The safety bound then
speaks of what will be evaluated, as it does not when a point of a continuous space is replaced by its nearest
row.
"""

from __future__ import annotations

import numpy as np

from hdsafebo.gp.sampling import thompson_sample
from hdsafebo.optimizers.base import Proposal
from hdsafebo.optimizers.core.empty_set import complete_batch
from hdsafebo.optimizers.local.base import CENTRES, RegionSearch, SearchingOptimizer
from hdsafebo.optimizers.local.row_regions import rows_near, separate_centres
from hdsafebo.problem import ContextualSet
from hdsafebo.search.region import TrustRegionRule
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray

_REGIONS = 4
"""The most trust regions at a time; they share the rows equally."""
_ELSEWHERE = 2000
"""Rows drawn from the whole set each round: an optimum far from all good trials may be among them."""
_NONE = np.empty(0, np.int64)


class RowSearch(RegionSearch):
    """See the module; the region's length is a number of rows."""

    # A posterior sample of some thousand rows takes milliseconds.
    rule = TrustRegionRule(initial=4000, least=500, most=16_000, successes=2, failures=3)

    def __init__(self, optimizer: SearchingOptimizer) -> None:
        super().__init__(optimizer)
        candidates = optimizer.problem.candidates
        assert candidates is not None, "the problem has a candidate set"
        self.candidates = candidates

    def propose(self, n: int) -> Proposal:
        """The best of the believed safe rows, each under a posterior sample of its own."""
        optimizer, features = self.optimizer, self.candidates.features
        left = np.setdiff1d(np.arange(len(features)), optimizer.taken, assume_unique=True)
        centres = self._centres()
        share = max(1, int(self.rule.initial) // len(centres))
        size = min(max(1, int(self.region.length) // len(centres)), len(left))
        near = rows_near(features, optimizer.taken, centres, size, share, optimizer.rng)
        elsewhere = optimizer.rng.choice(left, min(_ELSEWHERE, len(left)), replace=False)
        rows = np.unique(np.concatenate([*near, elsewhere]))
        inputs, surrogate = features[rows], optimizer.surrogate
        safe = surrogate.believed_safe(inputs, self.confidence)
        chosen = np.flatnonzero(safe)
        if len(chosen) > n:
            chosen = chosen[thompson_sample(surrogate.objective, inputs[chosen], n, optimizer.rng)]
        chosen = complete_batch(chosen, n, inputs, surrogate, optimizer.settings.empty_safe_set)
        return Proposal(
            rows=rows[chosen], trust_region_length=self.region.length, marked_unsafe=~safe[chosen]
        )

    def kernel_inputs(self, trials: Trials) -> FloatArray:
        """Features of the candidates; inputs outside the set count as their nearest row."""
        if isinstance(self.candidates, ContextualSet):
            return self.candidates.features_of(trials.x)
        rows = trials.candidate.copy()
        foreign = rows < 0
        if foreign.any():
            nearest = [self.candidates.nearest(x[None], _NONE) for x in trials.x[foreign]]
            rows[foreign] = np.concatenate(nearest)
        return self.candidates.features[rows]

    def _centres(self) -> FloatArray:
        """(k, p) the best trial, then the next best believed safe ones a length scale apart."""
        optimizer = self.optimizer
        rows = self.best_first(optimizer.feasible)[:CENTRES]
        inputs = self.kernel_inputs(optimizer.in_context(optimizer.trials[rows]))
        inputs = inputs[optimizer.surrogate.believed_safe(inputs, self.confidence)]
        best = self.kernel_inputs(optimizer.in_context(optimizer.trials[[optimizer.centre_row()]]))
        return separate_centres(best, inputs, optimizer.surrogate.objective.length_scale, _REGIONS)
