"""The trust region of TuRBO and its descendants: a box whose side doubles on success and halves on failure.

Eriksson, Pearce, Gardner, Turner and Poloczek, Scalable Global Optimization via Local Bayesian
Optimization, NeurIPS 2019, section 2 and supplement.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hdsafebo.gp.ard_process import WarmStart
from hdsafebo.optimizers.base import Optimizer
from hdsafebo.optimizers.settings import OptimizerSettings
from hdsafebo.search.region import IMPROVEMENT, TrustRegion, TrustRegionRule, safe_update
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray

# Sides in widths of the box, as TuRBO's supplement and BoTorch's tutorials of TuRBO and SCBO have them.
INITIAL_LENGTH = 0.8
MOST_LENGTH = 1.6
LEAST_LENGTH = 0.5**7
"""A region with a shorter side starts anew."""


class BoxRegionSettings(OptimizerSettings):
    """Settings of the methods with such a region.

    Attributes:
        candidates: points that Thompson sampling chooses among; None takes min(5000, max(2000, 200 d)).
    """

    candidates: int | None = Field(default=None, ge=1)

    def candidate_count(self, dimension: int) -> int:
        """Number of candidates in d dimensions."""
        return self.candidates or min(5000, max(2000, 200 * dimension))


S = TypeVar("S", bound=BoxRegionSettings)


class BoxRegionOptimizer(Optimizer[S]):
    """What TuRBO and SCBO share: a region, the trials since it began, and when it starts anew.

    When the side falls below `LEAST_LENGTH`, earlier trials are set aside and a Sobol design of 2 d points,
    at most as many as there were initial trials, comes first.
    """

    _region: TrustRegion
    _since: int
    _warm: WarmStart

    def prepare(self) -> None:
        """The first region, and no fits yet."""
        self._begin(since=0)

    def better(self, known: Trials, fresh: Trials) -> bool:
        """Whether a round's completed trials improve on those of the region before; neither is empty."""
        raise NotImplementedError

    def finish_round(self, trials: Trials) -> None:
        """Count a success or a failure, resize the region, and start anew when it is too small."""
        local = self._local()
        of_round = np.isin(local.id, trials.id)
        known, fresh = local[~of_round], local[of_round]
        if len(known) < self._design_size():
            return  # a design is no search: it neither succeeds nor fails
        success = len(fresh) > 0 and self.better(known, fresh)
        rule = box_rule(10, failure_tolerance(self.space.dimension, len(trials)))  # tau_s of the tutorials
        self._region = safe_update(self._region, success, rule)
        if self._region.length < LEAST_LENGTH:
            self._begin(since=len(self.trials))

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Region, where its history begins, and the last fits."""
        return {"region": asdict(self._region), "since": self._since}, self._warm.arrays()

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `method_state` gave."""
        self._region, self._since = TrustRegion(**state["region"]), state["since"]
        self._warm = WarmStart.of(arrays)

    def _begin(self, since: int) -> None:
        self._region = TrustRegion(INITIAL_LENGTH)
        self._since = since
        self._warm = WarmStart()  # the fits were of trials that are set aside

    def _local(self) -> Trials:
        """Completed trials of the present region."""
        known = self.trials[self._since :]
        return known[known.completed]

    def _design_size(self) -> int:
        """Completed trials a region needs before it samples: initial data, or a design after a restart."""
        if self._since == 0:
            return 1
        return max(1, min(2 * self.space.dimension, int(self.trials.initial.sum())))


def box_rule(successes: int, failures: int) -> TrustRegionRule:
    """The region's rule; no least length, since a region below the least starts anew with other data."""
    return TrustRegionRule(
        initial=INITIAL_LENGTH,
        least=0.0,
        most=MOST_LENGTH,
        successes=successes,
        failures=failures,
        restart=False,
    )


def improves(value: float, best: float) -> bool:
    """Whether an objective exceeds the best by enough to count as a success."""
    return bool(value > best + IMPROVEMENT * abs(best))


def failure_tolerance(dimension: int, batch: int) -> int:
    """Rounds without success that halve the side: ceil(max(4 / q, d / q)) (TuRBO, supplement)."""
    return int(np.ceil(max(4.0, dimension) / batch))


def relative_weights(length_scales: FloatArray) -> FloatArray:
    """(d,) length scales divided by their geometric mean: they shape the box and leave its volume."""
    return np.asarray(length_scales / np.exp(np.log(length_scales).mean()))
