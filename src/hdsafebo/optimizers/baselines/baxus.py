"""BAxUS: a trust region in a nested family of growing subspaces."""

from __future__ import annotations

from dataclasses import asdict
from math import floor, log
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hdsafebo.gp.ard import TRUST_REGION
from hdsafebo.gp.ard_process import WarmStart
from hdsafebo.gp.sampling import distinct_maxima
from hdsafebo.optimizers.baselines.box_region import (
    INITIAL_LENGTH,
    LEAST_LENGTH,
    BoxRegionSettings,
    box_rule,
    improves,
    relative_weights,
)
from hdsafebo.optimizers.baselines.count_sketch import CountSketch
from hdsafebo.optimizers.baselines.subspace import SubspaceOptimizer
from hdsafebo.search.candidates import box_candidates
from hdsafebo.search.region import TrustRegion, safe_update
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray

_NEW_BINS = 3
"""b, the new coordinates that a split of one gives; 3 as in BAxUS' own code."""
_SUCCESSES = 3
"""Successes in a row that double the side; 3 as in BAxUS' and TuRBO's own code (the tutorials: 10)."""


class BaxusSettings(BoxRegionSettings):
    """Settings of `baxus`.

    Attributes:
        budget: trials after which the subspace should have grown to the whole space; it sets how long each
            dimension is searched.
    """

    budget: int = Field(default=500, ge=1)


class Baxus(SubspaceOptimizer[BaxusSettings]):
    """Bayesian optimisation with adaptively expanding subspaces (Papenmeier et al., NeurIPS 2022).

    TuRBO within a count-sketch subspace of few dimensions. When the box falls below L_min every latent
    coordinate is split into b + 1, which keeps every observation where it was; the search goes on in
    the finer space with a box of the initial size. The failure tolerance is such that the whole
    space is reached when the budget is spent (their section 3.3); a failed round of q trials counts as q
    failures. In the whole space the box restarts with the data kept.
    """

    name = "baxus"
    Settings = BaxusSettings

    def prepare(self) -> None:
        """The first subspace and region."""
        super().prepare()
        self._region = TrustRegion(INITIAL_LENGTH)

    def first_sketch(self) -> CountSketch:
        """The subspace of d_init dimensions."""
        inputs = self.problem.bounds.shape[1]
        _, dimension = nesting(inputs, _NEW_BINS)
        return CountSketch.balanced(inputs, dimension, self.rng)

    def propose_latent(self, y: FloatArray, objective: FloatArray, n: int) -> tuple[FloatArray, float]:
        """n Thompson samples in the box around the best point."""
        process = self._warm.process("objective", y, objective, TRUST_REGION)
        half = 0.5 * self._region.length * relative_weights(process.fit.length_scales)
        count = max(self.settings.candidate_count(y.shape[1]), n)
        centre = y[np.argmax(objective)]
        candidates = box_candidates(centre, half, count, self.rng)
        chosen = distinct_maxima(process.paths(candidates, n, self.rng, centre))
        return candidates[chosen], self._region.length

    def finish_round(self, trials: Trials) -> None:
        """Count a success or failures, resize the box, and split when it is too small."""
        rows, _ = self._known()
        before = rows[~np.isin(rows, trials.id)]
        if len(before) == 0:
            return
        fresh = trials.objective[trials.completed]
        success = len(fresh) > 0 and improves(fresh.max(), self.trials.objective[before].max())
        rule = box_rule(_SUCCESSES, self.failure_tolerance)
        self._region = safe_update(self._region, success, rule, weight=len(trials))
        if self._region.length >= LEAST_LENGTH:
            return
        self._region = TrustRegion(INITIAL_LENGTH)
        self._sketch, parent = self._sketch.split(_NEW_BINS, self.rng)
        self._latent = self._latent[:, parent]
        self._warm = WarmStart()

    @property
    def failure_tolerance(self) -> int:
        """Failures in a row that halve the box, for the present dimension."""
        d = self._sketch.dimension
        inputs = self.problem.bounds.shape[1]
        if d == inputs:
            return d
        splits, first = nesting(inputs, _NEW_BINS)
        share = _NEW_BINS * self.settings.budget * d / (first * ((_NEW_BINS + 1) ** (splits + 1) - 1))
        halvings = max(1, floor(log(LEAST_LENGTH / INITIAL_LENGTH, 0.5)))
        return min(d, max(1, floor(round(share) / halvings)))

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Embedding, latent points, fits and box."""
        state, arrays = super().method_state()
        return state | {"region": asdict(self._region)}, arrays

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `method_state` gave."""
        super().restore_method_state(state, arrays)
        self._region = TrustRegion(**state["region"])


def nesting(inputs: int, new_bins: int) -> tuple[int, int]:
    """Number of splits and first dimension: d_init (b + 1)^splits comes nearest to D (section 3.3)."""
    splits = round(log(inputs, new_bins + 1)) if inputs > 1 else 0
    firsts = np.arange(1, new_bins + 1)
    return splits, int(firsts[np.argmin(np.abs(firsts * (new_bins + 1) ** splits - inputs))])
