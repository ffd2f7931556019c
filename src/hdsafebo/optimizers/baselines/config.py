"""CONFIG: global optimisation over the optimistic feasible set."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from hdsafebo.gp.sampling import thompson_sample
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.core.empty_set import complete_batch
from hdsafebo.optimizers.settings import SafeSetSettings
from hdsafebo.search.candidates import sobol_points


class ConfigSettings(SafeSetSettings):
    """Settings of `config`.

    Attributes:
        candidates: Sobol points of the box that are considered in a round; None takes
            min(5000, max(2000, 200 d)).
    """

    candidates: int | None = Field(default=None, ge=1)


class Config(Optimizer[ConfigSettings]):
    """Constrained efficient global optimisation (Xu, Jiang, Svetozarevic and Jones, ICML 2023).

    Their algorithm 1: maximise an optimistic view of the objective over the points whose upper confidence
    bound of every constraint meets its threshold. The optimistic view is a posterior sample here, as the
    paper sets it for this baseline, in place of the upper bound. Where no point is even optimistically
    feasible CONFIG declares the problem infeasible; `empty_safe_set` says what happens then.
    """

    name = "config"
    Settings = ConfigSettings

    def propose(self, n: int) -> Proposal:
        """n Thompson samples over the optimistic feasible set of the whole box."""
        d = self.space.dimension
        count = self.settings.candidates or min(5000, max(2000, 200 * d))
        points = self.space.pinned(sobol_points(max(count, n), d, self.rng))
        inputs = self.inputs_at(points)
        feasible = self.surrogate.believed_safe(inputs, self.settings.confidence)
        chosen = np.flatnonzero(feasible)
        if len(chosen) > n:
            chosen = chosen[thompson_sample(self.surrogate.objective, inputs[chosen], n, self.rng)]
        chosen = complete_batch(chosen, n, inputs, self.surrogate, self.settings.empty_safe_set)
        return Proposal(points[chosen], marked_unsafe=~feasible[chosen])
