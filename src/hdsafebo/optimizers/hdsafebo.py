"""HdSafeBO: the paper's Algorithm 1 with SafeUpdate (Algorithm 2).

Where text, listing and "the default setting of SCBO" say different things of the trust region, the defaults
follow SCBO, as BoTorch has it: l_t is the side of a box around x*, in widths of the searched box, and a
candidate differs from x* in 20 coordinates on average. On the paper's synthetic task this reading gives an
objective of 4.05 +- 0.14, a safety of 0.79 +- 0.01 and a violation of 35 +- 3 on seeds 0 to 11, where the
paper has 3.96 +- 0.15, 0.81 +- 0.02 and 27 +- 4. Two other readings have names of their own in the registry:
the listing taken literally, and l_t in fitted length scales.

Lines of Algorithm 1 and where they are:
    1      c_s, c_f <- 0                                     prepare
    2      x*, y* <- best safe point of D_0                  Optimizer.centre_row
    4      encode the data                                   Optimizer.observe and ask, once per trial
    5      update the Gaussian processes                     Optimizer.surrogate
    6      L_t, the trust region around x*                   propose, _box
    7      S_t, the optimistic safe set within L_t           propose, Surrogate.believed_safe
    8      maximise the acquisition function over S_t        propose, thompson_sample
    9      decode                                            Optimizer.ask
    10-12  evaluate, add to the data                         the caller, Optimizer.tell
    13     SafeUpdate                                        finish_round, safe_update
"""

from __future__ import annotations

from dataclasses import asdict
from math import ceil
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hdsafebo.gp.sampling import thompson_sample
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.core.empty_set import complete_batch
from hdsafebo.optimizers.settings import SafeSetSettings
from hdsafebo.search.candidates import sobol_points
from hdsafebo.search.region import TrustRegion, TrustRegionRule, safe_update
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray

# The paper uses "the default setting of SCBO"; these are BoTorch's.
_INITIAL_LENGTH = 0.8
"""l_0."""
_MOST_LENGTH = 1.6
"""l_max."""
_LEAST_LENGTH = 2.0**-7
"""l_min."""
_SUCCESSES = 10
"""tau_s."""


class HdSafeBOSettings(SafeSetSettings):
    """Settings of HdSafeBO. Where the paper leaves a reading open, the setting says which ones there are.

    Attributes:
        box: l_t is the "side" of the box, z* -+ l_t / 2, as in SCBO and the text of section 4.2, or its
            "half_width", z* -+ l_t, as line 6 of Algorithm 1 is printed.
        unit: l_t counts widths of the searched box ("box", as in SCBO) or fitted length scales
            ("length_scale", which the paper does not say).
        batch_success: a round succeeds when it "improved" the best safe objective (Algorithm 2, line 1),
            or only when it "improved_and_all_safe" (section 4.2: "while maintaining comprehensive safety").
        candidates: number of Sobol points in the box; None is BoTorch's min(5000, max(2000, 200 d)).
        perturbed: expected number of coordinates in which a candidate differs from the centre (SCBO's and
            TuRBO's mask uses 20); None lets all differ, as the listing has no mask.
        local: False searches the whole box (the paper's ablation without local search).
    """

    box: Literal["side", "half_width"] = "side"
    unit: Literal["box", "length_scale"] = "box"
    batch_success: Literal["improved", "improved_and_all_safe"] = "improved_and_all_safe"
    candidates: int | None = Field(default=None, ge=1)
    perturbed: int | None = Field(default=20, ge=1)
    local: bool = True


class HdSafeBO(Optimizer[HdSafeBOSettings]):
    """High-dimensional safe Bayesian optimisation (the paper's Algorithms 1 and 2)."""

    name = "hdsafebo"
    holds_contexts = True
    Settings = HdSafeBOSettings

    def prepare(self) -> None:
        """Line 1 of Algorithm 1, and l_0."""
        self.region = TrustRegion(_INITIAL_LENGTH)

    def propose(self, n: int) -> Proposal:
        """Lines 5 to 8 of Algorithm 1, for a batch."""
        centre = self.space.to_unit(self.trials.z[[self.centre_row()]])[0]  # x*
        beta = self.confidence
        length = self.region.length
        while True:
            candidates = self.space.pinned(self._candidates(centre, *self._box(centre, length)))  # line 6
            inputs = self.inputs_at(candidates)
            safe = self.surrogate.believed_safe(inputs, beta)  # lines 5 and 7
            if safe.sum() >= n or length <= _LEAST_LENGTH or not self.settings.local:
                break
            length /= 2  # too few candidates are believed safe: look closer to the point that was safe
        chosen = np.flatnonzero(safe)  # line 8
        if len(chosen) > n:
            chosen = chosen[thompson_sample(self.surrogate.objective, inputs[chosen], n, self.rng)]
        chosen = complete_batch(chosen, n, inputs, self.surrogate, self.settings.empty_safe_set)
        return Proposal(
            candidates[chosen],
            trust_region_length=length if self.settings.local else np.nan,
            marked_unsafe=~safe[chosen],
        )

    def finish_round(self, trials: Trials) -> None:
        """Line 13 of Algorithm 1: was the round a success (Algorithm 2, line 1), and the new region."""
        all_safe = bool(self.feasible[trials.id].all()) or self.settings.batch_success == "improved"
        success = all_safe and self._ledger.improved_by(trials.id)
        self.region = safe_update(self.region, success, self._rule(len(trials)))

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Length and counters of the trust region."""
        return asdict(self.region), {}

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `method_state` gave."""
        self.region = TrustRegion(**state)

    def _box(self, centre: FloatArray, length: float) -> tuple[FloatArray, FloatArray]:
        """Line 6: lower and upper corner of L_t in the unit cube."""
        if not self.settings.local:
            return np.zeros_like(centre), np.ones_like(centre)
        half: FloatArray | float = length / 2 if self.settings.box == "side" else length
        if self.settings.unit == "length_scale":
            half = half * self.surrogate.length_scale / self._stretch()
        return np.clip(centre - half, 0.0, 1.0), np.clip(centre + half, 0.0, 1.0)

    def _stretch(self) -> FloatArray:
        """(d,) how far kernel inputs move when one coordinate of the unit cube moves by one."""
        if self.problem.features is None:
            return self.space.metric
        matrix = self.metric.matrix
        lengths = np.abs(matrix) if matrix.ndim == 1 else np.linalg.norm(matrix, axis=0)
        return np.maximum(
            lengths, np.finfo(float).tiny
        )  # what no feature sees may move as far as the box goes

    def _candidates(self, centre: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
        """(k, d) points of the box, among which line 8 maximises."""
        d = self.space.dimension
        count = self.settings.candidates or min(5000, max(2000, 200 * d))
        points = lower + (upper - lower) * sobol_points(count, d, self.rng)
        if self.settings.perturbed is None or self.settings.perturbed >= d:
            return points
        moved = self.rng.random(points.shape) < self.settings.perturbed / d
        moved[np.arange(count), self.rng.integers(d, size=count)] = True
        return np.where(moved, points, np.clip(centre, 0.0, 1.0))

    def _rule(self, batch: int) -> TrustRegionRule:
        """Constants of Algorithm 2 for a round of q trials; tau_f is SCBO's ceil(max(4 / q, d / q))."""
        failures = ceil(max(4 / batch, self.space.dimension / batch))
        return TrustRegionRule(_INITIAL_LENGTH, _LEAST_LENGTH, _MOST_LENGTH, _SUCCESSES, failures)
