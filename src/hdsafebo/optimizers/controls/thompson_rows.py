"""Control: what the model alone is worth on a finite candidate set."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hdsafebo.errors import ProblemError
from hdsafebo.gp.sampling import thompson_sample
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.core.empty_set import complete_batch
from hdsafebo.optimizers.settings import SafeSetSettings
from hdsafebo.problem import CandidateSet
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray


class ThompsonRowsSettings(SafeSetSettings):
    """Settings of `thompson_rows`.

    Attributes:
        beta: of the safe set; -2 promises a safe probability of 0.977, as `hdsafebo_local` does.
        rows: rows drawn from the whole set in each round, among which one is chosen for each trial.
    """

    beta: float = -2.0
    rows: int = Field(default=8000, ge=1)


class ThompsonRows(Optimizer[ThompsonRowsSettings]):
    """Thompson sampling over the believed safe ones among rows that are drawn from the whole candidate set.

    It has the kernel features and the safety model of `hdsafebo_local` and no trust region: the difference
    between the two is what the search around the best trials is worth.

    Raises:
        ProblemError: the problem has no candidate set.
    """

    name = "thompson_rows"
    Settings = ThompsonRowsSettings
    uses = Optimizer.uses | {"candidate_rows"}

    def prepare(self) -> None:
        """Refuse a problem without rows."""
        if self.problem.candidates is None:
            raise ProblemError(f"thompson_rows needs a candidate set; problem {self.problem.name!r} has none")

    def propose(self, n: int) -> Proposal:
        """n rows, each the best of its own posterior sample."""
        features = self._rows().features
        left = np.setdiff1d(np.arange(len(features)), self.taken, assume_unique=True)
        rows = self.rng.choice(left, min(max(self.settings.rows, n), len(left)), replace=False)
        safe: NDArray[np.bool_] = self.surrogate.believed_safe(features[rows], self.confidence)
        chosen = np.flatnonzero(safe)
        if len(chosen) > n:
            chosen = chosen[thompson_sample(self.surrogate.objective, features[rows[chosen]], n, self.rng)]
        empty = self.settings.empty_safe_set
        chosen = complete_batch(chosen, n, features[rows], self.surrogate, empty)
        return Proposal(rows=rows[chosen], marked_unsafe=~safe[chosen])

    def kernel_inputs(self, trials: Trials) -> FloatArray:
        """(n, p) features of the rows; of an input outside the set, those of its nearest row."""
        candidates, rows = self._rows(), trials.candidate.copy()
        nothing = np.empty(0, np.int64)
        for i in np.flatnonzero(rows < 0):
            rows[i] = candidates.nearest(trials.x[[i]], nothing)[0]
        return candidates.features[rows]

    def _rows(self) -> CandidateSet:
        candidates = self.problem.candidates
        assert candidates is not None
        return candidates
