"""HdSafeBO for trials one at a time on a large finite set, with noisy outcomes.

What differs from the local variant, whose rounds are batches and whose outcomes repeat:

* The best trial is the one that the model believes best. The highest single outcome among noisy ones is the
  luckiest.
* A part of the trials are neighbours of the trials believed best: inputs that differ in one thing.
* The others come from a shortlist. Every few rounds the posterior mean is computed over many rows of the set;
  the best of those that are believed safe are the shortlist; a few rows from elsewhere join it each round.
* Once the best ones have been found, some of the trials repeat one of them: which of them is best is
  otherwise left to the noise (see `repetition`).

Outcomes drift from day to day. The target's model is fitted to outcomes less the effects of their days (see
`days`), on the session's scale (see `outcome_scale`).

Either way only rows that are believed safe are chosen, by the highest posterior mean or by the highest value
of a posterior sample (Thompson sampling).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hdsafebo.errors import ProblemError
from hdsafebo.gp.sampling import thompson_sample
from hdsafebo.optimizers.base import Proposal
from hdsafebo.optimizers.core.empty_set import complete_batch
from hdsafebo.optimizers.local.base import LocalSearch, SearchingOptimizer
from hdsafebo.optimizers.settings import SafeSetSettings
from hdsafebo.session.advice.days import fit_days
from hdsafebo.session.advice.repetition import top_two
from hdsafebo.session.advice.search import SessionProblem
from hdsafebo.session.candidates.finite_set import FiniteSet
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray, IntArray

_CHECKED = 4  # how many times the shortlist's length is checked for safety, best first


class ShortlistSettings(SafeSetSettings):
    """Settings.

    Attributes:
        beta: of the safe set; -3 promises a safe probability of 0.9987.
        scanned: rows drawn at random for each new shortlist.
        shortlist: its length.
        every: rounds from one shortlist to the next.
        elsewhere: rows drawn from the whole set each round.
        local: share of the trials that are neighbours of the best.
        centres: how many best trials have their neighbours considered.
        exploit: share of the trials that take the highest posterior mean.
        repeat: share of the trials that repeat one of the best, after the first rounds.
        first: rounds without repetitions.
        rivals: how many of the best trials may be repeated.
    """

    beta: float = -3.0
    scanned: int = Field(default=15_000, ge=1)
    shortlist: int = Field(default=1000, ge=1)
    every: int = Field(default=6, ge=1)
    elsewhere: int = Field(default=400, ge=1)
    local: float = Field(default=0.5, ge=0, le=1)
    centres: int = Field(default=3, ge=1)
    exploit: float = Field(default=0.6, ge=0, le=1)
    repeat: float = Field(default=0.3, ge=0, le=1)
    first: int = Field(default=20, ge=0)
    rivals: int = Field(default=40, ge=1)


class ShortlistSearch(LocalSearch):
    """See the module.

    Args:
        optimizer: of a session's problem over a finite set.

    Attributes:
        scale: on which outcomes are modelled.
    """

    def __init__(self, optimizer: SearchingOptimizer) -> None:
        super().__init__(optimizer)
        problem, settings = optimizer.problem, optimizer.settings
        if not isinstance(problem, SessionProblem) or not isinstance(problem.candidates, FiniteSet):
            raise ProblemError(
                f"{optimizer.name} searches the finite set of a session; {problem.name!r} has none"
            )
        assert isinstance(settings, ShortlistSettings)
        self.settings = settings
        self._set = problem.candidates
        self.scale = problem.scale
        self._rows = np.empty(0, np.int64)
        self._made: int | None = None  # round in which the shortlist was made
        self._days = np.empty(0, np.int64)
        self._theta = (1.0, 0.1, 0.0)  # of the model of days; chosen anew with each shortlist, none before
        self._today = 0

    @property
    def days(self) -> IntArray:
        """(n,) day of every trial; those added since the day began are of the present one."""
        missing = len(self.trials) - len(self._days)
        return np.concatenate([self._days, np.full(missing, self._today)])

    def begin_day(self, day: int, earlier: IntArray | None = None) -> None:
        """See `Optimizer.begin_day`."""
        self._days, self._today = self.days if earlier is None else earlier, day

    def refines(self) -> bool:
        """As often as there is a new shortlist; from one trial to the next hyper-parameters hardly change."""
        return int(self.trials.completed.sum()) % self.settings.every == 0

    def targets(self, rows: IntArray) -> FloatArray:
        """Outcomes on their scale, less the effects of their days."""
        trials, days = self.trials[rows], self.days[rows]
        modelled = self.scale.modelled(trials.objective)
        if len(np.unique(days)) < 2:
            return modelled
        model = fit_days(self.kernel_inputs(trials), modelled[:, None], days, (self._theta,))
        return np.asarray(modelled - model.effect[:, 0])

    def _choose_theta(self) -> None:
        """Hyper-parameters of the model of days from the present data; the surrogate is fitted anew."""
        rows = self.optimizer.rows_to_fit()
        trials, days = self.trials[rows], self.days[rows]
        if len(np.unique(days)) > 1:
            modelled = self.scale.modelled(trials.objective)
            self._theta = fit_days(self.kernel_inputs(trials), modelled[:, None], days).theta[0]
            self.optimizer.refit()

    def propose(self, n: int) -> Proposal:
        """Rows believed safe: one of the best trials, near them, or of the shortlist."""
        self.optimizer.centre_row()  # abstains where nothing safe is known
        free = np.ones(len(self._set.features), bool)
        free[self.optimizer.taken] = False
        if self._made is None or self.optimizer.round - self._made >= self.settings.every:
            self._choose_theta()
            self._rows, self._made = self._scan(), self.optimizer.round
        if self.optimizer.round >= self.settings.first and self.rng.random() < self.settings.repeat:
            rows = self._rivals()
            if len(rows):
                return Proposal(
                    rows=rows[[top_two(self.surrogate.objective, self._set.features[rows], self.rng)]]
                )
        if self.rng.random() < self.settings.local:
            rows = self._neighbours()
            rows, safe = self._believed(rows[free[rows]])
            if safe.any():
                return Proposal(rows=rows[self._choose(np.flatnonzero(safe), rows, n)])
        left = np.flatnonzero(free)
        elsewhere = self.rng.choice(left, min(self.settings.elsewhere, len(left)), replace=False)
        rows, safe = self._believed(np.union1d(self._rows[free[self._rows]], elsewhere))
        chosen = complete_batch(
            self._choose(np.flatnonzero(safe), rows, n),
            n,
            self._set.features[rows],
            self.surrogate,
            self.settings.empty_safe_set,
        )
        return Proposal(rows=rows[chosen], marked_unsafe=~safe[chosen])

    def _believed(self, rows: IntArray) -> tuple[IntArray, NDArray[np.bool_]]:
        """The rows, and True for those that are believed safe."""
        return rows, self.surrogate.believed_safe(self._set.features[rows], self.settings.confidence)

    def _best(self) -> IntArray:
        """Rows of the trials that were safe, the highest posterior mean first."""
        rows = np.unique(self.trials.candidate[self.optimizer.feasible])
        mean = self.surrogate.objective.predict_mean(self._set.features[rows])
        return rows[np.argsort(-mean, kind="stable")]

    def _rivals(self) -> IntArray:
        """The best rows that were always safe, are believed to be, and may be proposed now."""
        unsafe = self.trials.candidate[self.trials.completed & ~self.optimizer.feasible]
        best = self._best()[: self.settings.rivals]
        rows, safe = self._believed(best[~np.isin(best, np.concatenate([unsafe, self.optimizer.elsewhere]))])
        return rows[safe]

    def _neighbours(self) -> IntArray:
        """Rows next to the safe trials of the highest posterior means."""
        best = self._best()[: self.settings.centres]
        return np.unique(np.concatenate([best[:0], *(self._set.neighbours(int(row)) for row in best)]))

    def _choose(self, safe: IntArray, rows: IntArray, n: int) -> IntArray:
        """Up to n of the positions of rows believed safe: by the mean, or by posterior samples."""
        if len(safe) <= n:
            return safe
        inputs = self._set.features[rows]
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

    def state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """The shortlist and when it was made; the days and their model."""
        state = {"made": self._made, "theta": self._theta, "today": self._today}
        return state, {"rows": self._rows, "days": self.days}

    def restore(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `state` gave."""
        self._made, self._today = state["made"], state["today"]
        self._theta = tuple(state["theta"])
        self._rows, self._days = arrays["rows"], arrays["days"]


class HdSafeBOShortlist(SearchingOptimizer[ShortlistSettings]):
    """The optimiser that searches by a shortlist."""

    name = "hdsafebo_shortlist"
    Settings = ShortlistSettings

    def prepare(self) -> None:
        """Make the search."""
        self._search = self._shortlist = ShortlistSearch(self)  # refuses a problem that is no session's

    def make_search(self) -> ShortlistSearch:
        """The only one."""
        return self._shortlist

    def begin_day(self, day: int, earlier: IntArray | None = None) -> None:
        """The search knows of days."""
        self._shortlist.begin_day(day, earlier)

    def in_units(self, mean: FloatArray, deviation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """From the scale on which outcomes are modelled."""
        return self._shortlist.scale.shown(mean, deviation)

    @property
    def taken(self) -> IntArray:
        """As `Optimizer.taken`; the rows forbidden elsewhere are most of the set, so nothing is sorted."""
        candidates = self.problem.candidates
        assert candidates is not None, "a session's finite set"
        mask = np.zeros(len(candidates.features), bool)
        for rows in (self.trials.candidate, self.elsewhere):
            mask[rows[rows >= 0]] = True
        return np.flatnonzero(mask)
