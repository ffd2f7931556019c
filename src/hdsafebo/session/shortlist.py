"""HdSafeBO for trials one at a time on a large finite set, with noisy outcomes.

What differs from the local variant, whose rounds are batches and whose outcomes repeat:

* The best trial is the one that the model believes best. The highest single outcome among noisy ones is the
  luckiest.
* Every few rounds the posterior mean is computed over many rows of the set; the best of those that are
  believed safe are the shortlist. Each round chooses among the shortlist and a few rows from elsewhere, all
  believed safe: either the highest posterior mean, or the highest of a posterior sample (Thompson sampling).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hdsafebo.errors import ProblemError
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.empty_set import complete_batch
from hdsafebo.optimizers.settings import OptimizerSettings
from hdsafebo.problem import FloatArray, IntArray, Trials
from hdsafebo.sampling import thompson_sample

_CHECKED = 4  # how many times the shortlist's length is checked for safety, best first


class ShortlistSettings(OptimizerSettings):
    """Settings.

    Attributes:
        beta: of the safe set; -3 promises a safe probability of 0.9987.
        scanned: rows drawn at random for each new shortlist.
        shortlist: its length.
        every: rounds from one shortlist to the next.
        elsewhere: rows drawn from the whole set each round.
        exploit: share of the trials that take the highest posterior mean.
    """

    beta: float = -3.0
    scanned: int = Field(default=15_000, ge=1)
    shortlist: int = Field(default=1000, ge=1)
    every: int = Field(default=6, ge=1)
    elsewhere: int = Field(default=400, ge=1)
    exploit: float = Field(default=0.6, ge=0, le=1)


class HdSafeBOShortlist(Optimizer):
    """See the module."""

    name = "hdsafebo_shortlist"
    Settings = ShortlistSettings
    settings: ShortlistSettings

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        if self.problem.candidates is None:
            raise ProblemError(f"{self.name} searches a finite set; {self.problem.name!r} has none")
        self._set = self.problem.candidates
        self._rows = np.empty(0, np.int64)
        self._made: int | None = None  # round in which the shortlist was made

    def propose(self, n: int) -> Proposal:
        """Rows of the shortlist and of elsewhere, believed safe."""
        self.centre_row()  # abstains where nothing safe is known
        free = np.ones(len(self._set.features), bool)
        free[self.taken] = False
        if self._made is None or self.round - self._made >= self.settings.every:
            self._rows, self._made = self._scan(), self.round
        left = np.flatnonzero(free)
        elsewhere = self.rng.choice(left, min(self.settings.elsewhere, len(left)), replace=False)
        rows = np.union1d(self._rows[free[self._rows]], elsewhere)
        inputs = self._set.features[rows]
        safe = self.surrogate.believed_safe(inputs, self.settings.confidence)
        chosen = self._choose(np.flatnonzero(safe), inputs, n)
        chosen = complete_batch(chosen, n, inputs, self.surrogate, self.settings.empty_safe_set)
        return Proposal(rows=rows[chosen], marked_unsafe=~safe[chosen])

    def _choose(self, safe: IntArray, inputs: FloatArray, n: int) -> IntArray:
        """Up to n of the rows believed safe: by the mean, or by posterior samples."""
        if len(safe) <= n:
            return safe
        if self.rng.random() < self.settings.exploit:
            mean = self.surrogate.objective.predict_mean(inputs[safe])
            return safe[np.argsort(-mean, kind="stable")[:n]]
        return safe[thompson_sample(self.surrogate.objective, inputs[safe], n, self.rng)]

    def _scan(self) -> IntArray:
        """A new shortlist: of random rows and the old ones those of highest mean, believed safe.

        Rows that are not permitted at present are scanned too: a current that must be approached in steps is
        worth approaching.
        """
        tried = np.zeros(len(self._set.features), bool)
        own = self.trials.candidate
        tried[own[own >= 0]] = True
        rows = self.rng.choice(len(tried), min(self.settings.scanned, len(tried)), replace=False)
        rows = np.union1d(rows, self._rows)
        rows = rows[~tried[rows]]
        mean = self.surrogate.objective.predict_mean(self._set.features[rows])
        rows = rows[np.argsort(-mean, kind="stable")[: _CHECKED * self.settings.shortlist]]
        safe = self.surrogate.believed_safe(self._set.features[rows], self.settings.confidence)
        return rows[safe][: self.settings.shortlist]

    def kernel_inputs(self, trials: Trials) -> FloatArray:
        """Features of the candidates; every input of a finite set's session has a row."""
        return self._set.features[trials.candidate]

    @property
    def taken(self) -> IntArray:
        """As `Optimizer.taken`; the rows forbidden elsewhere are most of the set, so nothing is sorted."""
        mask = np.zeros(len(self._set.features), bool)
        for rows in (self.trials.candidate, self._elsewhere):
            mask[rows[rows >= 0]] = True
        return np.flatnonzero(mask)

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """The shortlist and when it was made."""
        return {"made": self._made}, {"rows": self._rows}

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `method_state` gave."""
        self._made, self._rows = state["made"], arrays["rows"]
