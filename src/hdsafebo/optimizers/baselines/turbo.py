"""TuRBO-1: Thompson sampling within one trust region, safety left aside."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdsafebo.gp.ard import TRUST_REGION
from hdsafebo.gp.ard_process import WarmStart
from hdsafebo.gp.sampling import distinct_maxima
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.baselines.box_region import BoxRegionSettings, failure_tolerance, relative_weights
from hdsafebo.search.candidates import box_candidates, sobol_points
from hdsafebo.search.region import IMPROVEMENT, TrustRegion, safe_update
from hdsafebo.trials import Trials


class Turbo(Optimizer[BoxRegionSettings]):
    """Trust-region Bayesian optimisation with one region (Eriksson et al., NeurIPS 2019).

    The centre is the best point of the region's history, the box is shaped by the fitted length scales,
    and every trial of a batch maximises its own posterior sample over perturbed Sobol candidates. When the
    side falls below L_min, the region starts anew: earlier data are set aside and a design of 2 d Sobol
    points (at most as many as there were initial trials) is evaluated first. Safety is ignored.
    """

    name = "turbo"
    Settings = BoxRegionSettings
    uses = frozenset({"latent_space"})

    def prepare(self) -> None:
        """The first region, and no fits yet."""
        self._region = TrustRegion(self.settings.initial_length)
        self._since = 0
        self._warm = WarmStart()

    def propose(self, n: int) -> Proposal:
        """n Thompson samples in the box, or n points of the design that precedes them."""
        if self._design_open():
            points = sobol_points(n, self.space.dimension, self.rng)
            return Proposal(points=points, trust_region_length=self._region.length)
        local = self._local()
        x, y = self.space.to_unit(local.z), local.objective
        process = self._warm.process("objective", x, y, TRUST_REGION)
        half = 0.5 * self._region.length * relative_weights(process.fit.length_scales)
        centre = np.clip(x[np.argmax(y)], 0.0, 1.0)
        count = self.settings.candidate_count(self.space.dimension)
        candidates = box_candidates(centre, half, max(count, n), self.rng)
        chosen = distinct_maxima(process.paths(candidates, n, self.rng, centre))
        return Proposal(points=candidates[chosen], trust_region_length=self._region.length)

    def finish_round(self, trials: Trials) -> None:
        """Count a success or a failure, resize the region, and start anew when it is too small."""
        local = self._local()
        earlier = local.objective[~np.isin(local.id, trials.id)]
        if len(earlier) < self._design_size():
            return
        best = earlier.max()
        fresh = trials.objective[trials.completed]
        success = bool(len(fresh)) and fresh.max() > best + IMPROVEMENT * abs(best)
        tolerance = failure_tolerance(self.space.dimension, len(trials))
        self._region = safe_update(self._region, success, self.settings.rule(tolerance))
        if self._region.length < self.settings.min_length:
            self._region = TrustRegion(self.settings.initial_length)
            self._since = len(self.trials)
            self._warm = WarmStart()

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Region, where its history begins, and the last fits."""
        return {"region": asdict(self._region), "since": self._since}, self._warm.arrays()

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `method_state` gave."""
        self._region, self._since = TrustRegion(**state["region"]), state["since"]
        self._warm = WarmStart.of(arrays)

    def _local(self) -> Trials:
        """Completed trials of the present region."""
        known = self.trials[self._since :]
        return known[known.completed]

    def _design_size(self) -> int:
        """Completed trials a region needs before it samples: initial data, or a design after a restart."""
        if self._since == 0:
            return 1
        return max(1, min(2 * self.space.dimension, int(self.trials.initial.sum())))

    def _design_open(self) -> bool:
        return len(self._local()) < self._design_size()
