"""The trust region of TuRBO and its descendants: a box whose side doubles on success and halves on failure.

Eriksson, Pearce, Gardner, Turner and Poloczek, Scalable Global Optimization via Local Bayesian
Optimization, NeurIPS 2019, section 2 and supplement.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field, model_validator

from hdsafebo.optimizers.settings import OptimizerSettings
from hdsafebo.search.region import TrustRegionRule
from hdsafebo.typing import FloatArray


class BoxRegionSettings(OptimizerSettings):
    """Settings of the methods with such a region; lengths are sides in widths of the box.

    Attributes:
        initial_length: L_0.
        max_length: L_max.
        min_length: L_min; below it the region restarts.
        success_tolerance: successes in a row that double the side (10 in BoTorch's tutorials of TuRBO and
            SCBO and in the paper, 3 in TuRBO's own).
        candidates: points that Thompson sampling chooses among; None takes min(5000, max(2000, 200 d)).
    """

    initial_length: float = Field(default=0.8, gt=0)
    max_length: float = Field(default=1.6, gt=0)
    min_length: float = Field(default=0.5**7, gt=0)
    success_tolerance: int = Field(default=10, ge=1)
    candidates: int | None = Field(default=None, ge=1)

    @model_validator(mode="after")
    def _ordered(self) -> BoxRegionSettings:
        if not self.min_length < self.initial_length <= self.max_length:
            raise ValueError(
                f"expected min_length < initial_length <= max_length, got "
                f"{self.min_length}, {self.initial_length}, {self.max_length}"
            )
        return self

    def rule(self, failure_tolerance: int) -> TrustRegionRule:
        """The region's rule; no least length, since a region below L_min starts anew with other data."""
        return TrustRegionRule(
            initial=self.initial_length,
            least=0.0,
            most=self.max_length,
            successes=self.success_tolerance,
            failures=failure_tolerance,
            restart=False,
        )

    def candidate_count(self, dimension: int) -> int:
        """Number of candidates in d dimensions."""
        return self.candidates or min(5000, max(2000, 200 * dimension))


def failure_tolerance(dimension: int, batch: int) -> int:
    """Rounds without success that halve the side: ceil(max(4 / q, d / q)) (TuRBO, supplement)."""
    return int(np.ceil(max(4.0, dimension) / batch))


def relative_weights(length_scales: FloatArray) -> FloatArray:
    """(d,) length scales divided by their geometric mean: they shape the box and leave its volume."""
    return np.asarray(length_scales / np.exp(np.log(length_scales).mean()))
