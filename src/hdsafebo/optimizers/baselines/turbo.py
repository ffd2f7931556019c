"""TuRBO-1: Thompson sampling within one trust region, safety left aside."""

from __future__ import annotations

import numpy as np

from hdsafebo.gp.ard import TRUST_REGION
from hdsafebo.gp.sampling import distinct_maxima
from hdsafebo.optimizers.base import Proposal
from hdsafebo.optimizers.baselines.box_region import (
    BoxRegionOptimizer,
    BoxRegionSettings,
    improves,
    relative_weights,
)
from hdsafebo.search.candidates import box_candidates, sobol_points
from hdsafebo.trials import Trials


class Turbo(BoxRegionOptimizer[BoxRegionSettings]):
    """Trust-region Bayesian optimisation with one region (Eriksson et al., NeurIPS 2019).

    The centre is the best point of the region's history, the box is shaped by the fitted length scales,
    and every trial of a batch maximises its own posterior sample over perturbed Sobol candidates. Safety is
    ignored.
    """

    name = "turbo"
    Settings = BoxRegionSettings
    uses = frozenset({"latent_space"})

    def propose(self, n: int) -> Proposal:
        """n Thompson samples in the box, or n points of the design that precedes them."""
        local = self._local()
        if len(local) < self._design_size():
            points = sobol_points(n, self.space.dimension, self.rng)
            return Proposal(points=points, trust_region_length=self._region.length)
        x, y = self.space.to_unit(local.z), local.objective
        process = self._warm.process("objective", x, y, TRUST_REGION)
        half = 0.5 * self._region.length * relative_weights(process.fit.length_scales)
        centre = np.clip(x[np.argmax(y)], 0.0, 1.0)
        count = self.settings.candidate_count(self.space.dimension)
        candidates = box_candidates(centre, half, max(count, n), self.rng)
        chosen = distinct_maxima(process.paths(candidates, n, self.rng, centre))
        return Proposal(points=candidates[chosen], trust_region_length=self._region.length)

    def better(self, known: Trials, fresh: Trials) -> bool:
        """Whether the best of a round exceeds the best before."""
        return improves(fresh.objective.max(), known.objective.max())
