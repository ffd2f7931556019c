"""One run: ask, evaluate, tell, make durable, until the trials are used up; resumable at any moment.

A run that was cut goes on from the optimiser's last saved state. Rounds after that state are in the
journal with their results: they are asked again, must be the same points to the bit, and are told the
results of the journal. A problem that depends on what was evaluated before is taken through the same
evaluations again.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hdsafebo.campaign.progress import Beacon
from hdsafebo.campaign.rounds import Round, RunJournal, points_digest
from hdsafebo.campaign.run_spec import RunSpec, budget_of, identity_of, settings_of
from hdsafebo.errors import JournalError, NoSafePointError, SurrogateError
from hdsafebo.gp.safe_set import alpha_of
from hdsafebo.optimizers.base import Optimizer
from hdsafebo.optimizers.registry import load_optimizer, make_optimizer, method_class
from hdsafebo.optimizers.settings import CentreSettings
from hdsafebo.params import Params, Space
from hdsafebo.problem import Problem
from hdsafebo.problems.registry import Task, make_task
from hdsafebo.runs.schema import Rows, RunCounts, safety_columns
from hdsafebo.runs.write import join_rows, rows_of
from hdsafebo.trials import Evaluation, Trials

_STATE_SHARE = 0.05  # of the run's time may go into saving states


@dataclass(frozen=True)
class RunResult:
    """A finished run.

    Attributes:
        seed: its seed.
        rows: its trials.
        facts: what does not depend on the seed (see `runs.schema.RunMetadata`).
        counts: of failed fits, marked and missing trials.
        code: digest of the modules that computed it.
    """

    seed: int
    rows: Rows
    facts: dict[str, Any]
    counts: RunCounts
    code: str

    @property
    def abstained(self) -> str | None:
        """Why the method ended before the trials were used up; None if it did not."""
        return self.counts.abstained


def run(spec: RunSpec) -> RunResult:
    """Compute a run, or the rounds that its journal lacks.

    Raises:
        JournalError: its files are damaged, cannot be written, or are not reproduced.
        CampaignError: the campaign was stopped; finished rounds are kept.
        HdSafeBOError: what the task or the method raise.
    """
    params = spec.checked_params()
    task = make_task(spec.task, params, seed=spec.seed, root=Path(spec.root))
    identity = identity_of(spec, params, task.inputs)
    with RunJournal(spec.journal, spec.name, identity) as journal:
        if journal.outcome is None:
            _Run(spec, params, task, journal).finish()
        assert journal.outcome is not None
        rows = join_rows([entry.rows for entry in journal.rounds])
        counts = RunCounts(**journal.outcome["counts"])
        return RunResult(spec.seed, rows, journal.outcome["facts"], counts, identity["code"])


class _Run:
    """A run in progress."""

    def __init__(self, spec: RunSpec, params: Params, task: Task, journal: RunJournal) -> None:
        method = params.methods[spec.method]
        settings = settings_of(params, spec.task, spec.method)
        searched = task.spaces.get(method.space, task)
        self.problem: Problem = searched.problem
        self.knowledge = task.knowledge
        self.budget = budget_of(params, spec.task)
        self.journal = journal
        self.beacon = Beacon(spec)
        self.initial, self.candidate = self.problem.initial(self.budget.initial, spec.initial_rng())
        latent = method.space != "original" and searched.embedding is not None
        embedding = searched.embedding(self.initial) if latent and searched.embedding is not None else None
        self.space: Space = method.space if latent or searched is not task else "original"
        state = journal.state
        self.saved_rounds = 0 if state is None else state[0] + 1
        self.optimizer: Optimizer
        if state is None:
            self.optimizer = make_optimizer(
                method.algorithm,
                self.problem,
                embedding=embedding,
                seed=spec.method_seed(),
                bounds=searched.latent_bounds if latent else None,
                **(_fill_rounds(method.algorithm, settings) | settings),
            )
        else:
            self.optimizer = load_optimizer(method.algorithm, state[1], self.problem, embedding)
        self.own_design = not self.optimizer.uses_initial_data
        self._state_seconds = 0.0
        self._state_time = time.monotonic()

    def finish(self) -> None:
        """Do all rounds that are missing."""
        abstained = self._all_rounds()
        self.journal.finish({"facts": self._facts(), "counts": self._counts(abstained).model_dump()})

    def _all_rounds(self) -> str | None:
        """Why the method abstained from the rest of the trials; None if it did not."""
        self._pass_saved_rounds()
        number = self.saved_rounds
        if number == 0:
            if self.own_design:
                self._round(number, lambda: self.optimizer.ask(self.budget.initial), self._tell)
            else:
                self._round(number, self._ask_initial, self._observe)
            number += 1
        while len(self.optimizer.trials) < self.budget.trials:
            try:
                self._round(number, self._ask, self._tell)
            except (NoSafePointError, SurrogateError) as error:
                return str(error)
            number += 1
        return None

    def _pass_saved_rounds(self) -> None:
        """Take a problem with a memory through the rounds that the saved state already knows."""
        if not self.problem.depends_on_history:
            return
        first = 0
        for entry in self.journal.rounds[: self.saved_rounds]:
            trials = self.optimizer.trials[first : first + len(entry.rows["trial"])]
            self._same_points(entry, trials)
            self._same_values(entry, trials.with_results(self.problem.evaluate(trials)))
            first += len(trials)
            self.beacon.report(first)

    def _round(self, number: int, ask: Callable[[], Trials], tell: Callable[[Trials], None]) -> None:
        """One round, new or from the journal."""
        start = time.process_time()  # of this process, which has one thread: other jobs do not change it
        trials = ask()
        asked = time.process_time()
        known = self.journal.rounds[number] if number < len(self.journal.rounds) else None
        if known is not None:
            self._same_points(known, trials)
        if known is None or self.problem.depends_on_history:
            told = trials.with_results(self.problem.evaluate(trials))
        else:
            told = trials.with_results(_evaluation_of(known, self.problem))
        evaluated = time.process_time()
        if known is not None:
            self._same_values(known, told)
        tell(told)
        if known is None:
            rows = rows_of(
                self._as_recorded(told),
                self.problem,
                seed=self.beacon.seed,
                method_seconds=asked - start + time.process_time() - evaluated,
                evaluate_seconds=evaluated - asked,
            )
            self.journal.append(Round(points_digest(trials), rows))
            self._save_state_sometimes()
        self.beacon.report(len(self.optimizer.trials))

    def _as_recorded(self, told: Trials) -> Trials:
        """Trials with the rounds of the run file, whose round 0 holds the initial trials.

        A method that cannot use given data asks for a design of its own first; that design is initial too.
        """
        if not self.own_design:
            return told
        return replace(told, round=told.round - 1, initial=told.round == 1)

    def _ask_initial(self) -> Trials:
        z = (
            self.initial
            if self.optimizer.embedding is None
            else self.optimizer.embedding.encode(self.initial)
        )
        return Trials.pending(
            self.initial,
            z,
            len(self.problem.safety),
            candidate=self.candidate,
            initial=np.ones(len(self.initial), bool),
        )

    def _observe(self, told: Trials) -> None:
        self.optimizer.observe(
            told.x, told.objective, told.safety, status=told.status, candidate=told.candidate, initial=True
        )

    def _ask(self) -> Trials:
        return self.optimizer.ask(min(self.budget.batch, self.budget.trials - len(self.optimizer.trials)))

    def _tell(self, told: Trials) -> None:
        self.optimizer.tell(told, told.objective, told.safety, status=told.status)

    def _same_points(self, entry: Round, trials: Trials) -> None:
        if points_digest(trials) != entry.points:
            self._differs("other points were proposed than", trials)

    def _same_values(self, entry: Round, told: Trials) -> None:
        known = _evaluation_of(entry, self.problem)
        same = np.array_equal(told.objective, known.objective, equal_nan=True)
        if not (same and np.array_equal(told.safety, known.safety, equal_nan=True)):
            self._differs("the evaluation gave other values than", told)

    def _differs(self, what: str, trials: Trials) -> None:
        raise JournalError(
            f"{self.journal.directory}: {what} the journal holds for trials {trials.id[0]} to "
            f"{trials.id[-1]}: another machine or library computes other bits; continue where the run "
            "was begun, or remove this directory to compute the run again"
        )

    def _save_state_sometimes(self) -> None:
        """Save the state when saving takes a small share of the time since the last save."""
        if time.monotonic() - self._state_time < self._state_seconds / _STATE_SHARE:
            return
        start = time.monotonic()
        self.journal.save_state(self.optimizer.save)
        self._state_time = time.monotonic()
        self._state_seconds = self._state_time - start

    def _counts(self, abstained: str | None) -> RunCounts:
        fits = self.optimizer.fit_counts
        trials = self.optimizer.trials
        return RunCounts(
            fits=fits.fits,
            jitters=fits.jitters,
            fallbacks=fits.fallbacks,
            marked=int(trials.marked_unsafe.sum()),
            missing=self.budget.trials - len(trials),
            abstained=abstained,
            certified=self.optimizer.certified_points,
        )

    def _facts(self) -> dict[str, Any]:
        kind = type(self.optimizer)
        beta = self.optimizer.model_settings.confidence if kind.consults_model else None
        return {
            "safety_names": [s.name for s in self.problem.safety],
            "thresholds": [s.threshold for s in self.problem.safety],
            "beta": beta,
            "guaranteed_alpha": None if beta is None else alpha_of(beta),
            "optimum": self.problem.optimum,
            "space": self.space,
            "dimension": int(self.optimizer.trials.z.shape[1]),
            "given": self.knowledge.given(),
            "unused": self.knowledge.unused(kind.uses, original=self.space == "original"),
        }


def _evaluation_of(entry: Round, problem: Problem) -> Evaluation:
    """The results that the journal holds of a round."""
    safety = np.stack([entry.rows[name] for name in safety_columns(problem)], axis=1)
    return Evaluation(entry.rows["objective"], safety, entry.rows["status"] == "failed")


def _fill_rounds(method: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Setting of a method that could abstain and must not: methods are compared at equal numbers of trials.

    A trial that was not believed safe is marked, and counts as what it turns out to be.
    """
    kind, fixed = method_class(method)
    needs_safe_trial = (
        issubclass(kind.Settings, CentreSettings) and (fixed | settings).get("start") != "centre"
    )
    return {"empty_safe_set": "mark"} if needs_safe_trial else {}
