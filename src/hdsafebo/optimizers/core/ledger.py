"""The table of trials: what was proposed, what came of it, and nothing ever lost or counted twice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import TrialError
from hdsafebo.optimizers.core.growing import GrowingRows
from hdsafebo.optimizers.core.results import CheckedResults
from hdsafebo.problem import Problem
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import FloatArray, IntArray


class Ledger:
    """All trials of one optimiser; the id of a trial is its row.

    Attributes:
        trials: the table.
    """

    def __init__(self, problem: Problem, code_dimension: int) -> None:
        self._binding = np.array([s.modelled or s.reported for s in problem.safety])
        self._thresholds = np.array([s.threshold for s in problem.safety])
        self._names = [s.name for s in problem.safety]
        self._x, self._z = GrowingRows(), GrowingRows()
        empty = np.empty((0, problem.bounds.shape[1]))
        self.trials = Trials.pending(empty, np.empty((0, code_dimension)), len(problem.safety))

    def __len__(self) -> int:
        return len(self.trials)

    def append(self, trials: Trials) -> None:
        """Add a copy of trials whose ids continue the table's."""
        table = self.trials if len(self.trials) else trials[:0]  # the first trials settle the length of codes
        columns = {
            f.name: np.concatenate([getattr(table, f.name), getattr(trials, f.name)])
            for f in fields(Trials)
            if f.name not in ("x", "z")
        }
        x = self._x.extended(table.x, trials.x)
        codes_are_inputs = table.z is table.x and trials.z is trials.x
        z = x if codes_are_inputs else self._z.extended(table.z, trials.z)
        self.trials = Trials(**columns, x=x, z=z)

    def ids_of(self, trials: Trials | Sequence[int] | IntArray) -> IntArray:
        """Ids of trials, or the given ids.

        Raises:
            TrialError: an id that is not in the table, or trials whose inputs differ from those in the table.
        """
        try:
            given = trials.id if isinstance(trials, Trials) else np.asarray(trials)
        except ValueError:
            raise TrialError(
                f"trials are {trials!r}; expected trials from ask, or a list of their ids"
            ) from None
        if given.ndim != 1 or not (np.issubdtype(given.dtype, np.integer) or len(given) == 0):
            raise TrialError(f"trials are {given!r}; expected trials from ask, or a list of their ids")
        unknown = given[(given < 0) | (given >= len(self.trials))]
        if len(unknown):
            raise TrialError(
                f"unknown trials {unknown.tolist()[:10]}; known are the ids 0 to {len(self.trials) - 1}"
            )
        ids = given.astype(np.int64)
        if isinstance(trials, Trials) and not np.array_equal(trials.x, self.trials.x[ids]):
            changed = ids[(trials.x != self.trials.x[ids]).any(axis=1)]
            raise TrialError(
                f"inputs of trials {changed.tolist()[:10]} differ from those that were proposed; "
                "report inputs of one's own with observe"
            )
        return ids

    def record(
        self,
        ids: IntArray,
        results: CheckedResults,
        *,
        noise: FloatArray | None = None,
        run: Trials | None = None,
    ) -> IntArray:
        """Fill in results, all or none of them; a result that is already there is not counted again.

        Args:
            ids: of the trials.
            results: one per id.
            noise: (n, 1 + m) known standard deviations; None leaves what is on record.
            run: the trials with the inputs that were really run; None means as asked.

        Returns:
            Numbers of the rounds that have all their results now and had not before, in order.

        Raises:
            TrialError: a result, an input or a noise that differs from the one already recorded, which stays,
                or from another one of the same trial in this call.
        """
        fresh = self.trials.status[ids] == Status.PENDING
        self._check_said_once(ids, fresh, noise, run)
        updated = self._filled(ids, results)
        if run is not None:
            updated = self._amended(updated, ids, fresh, run)
        if noise is not None:
            table = updated.noise.copy()
            table[ids[fresh]] = noise[fresh]
            updated = replace(updated, noise=table)
        waiting = np.unique(self.trials.round[self.trials.status == Status.PENDING])
        still = np.unique(updated.round[updated.status == Status.PENDING])
        self.trials = updated
        return np.setdiff1d(waiting, still)

    def round(self, number: int) -> Trials:
        """The trials that were asked in one round."""
        return self.trials[self.trials.round == number]

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """(n,) True for completed trials whose every safety value meets its threshold.

        Values of functions that are neither modelled nor reported are on record, and bind nobody.
        """
        with np.errstate(invalid="ignore"):
            met = (self.trials.safety >= self._thresholds) | ~self._binding
        return np.asarray(self.trials.completed & met.all(axis=1))

    def best_row(self, among: NDArray[np.bool_]) -> int | None:
        """Row of the highest objective among the marked trials; None when none is marked."""
        rows = np.flatnonzero(among)
        return int(rows[np.argmax(self.trials.objective[rows])]) if len(rows) else None

    def improved_by(self, ids: IntArray) -> bool:
        """Whether the best feasible objective of these trials exceeds that of all others."""
        feasible = self.feasible
        new = np.isin(self.trials.id, ids)
        best, before = self.best_row(feasible & new), self.best_row(feasible & ~new)
        if best is None:
            return False
        return before is None or bool(self.trials.objective[best] > self.trials.objective[before])

    def least_violation_row(self) -> int:
        """Row of the completed trial that violates least, in standard deviations of each safety function."""
        rows = np.flatnonzero(self.trials.completed)
        safety = self.trials.safety[rows]
        spread = safety.std(axis=0)
        missing = np.maximum(self._thresholds - safety, 0.0) / np.where(spread > 0, spread, 1.0)
        return int(rows[np.argmin(missing[:, self._binding].sum(axis=1))])

    def describe_thresholds(self) -> str:
        """Names and thresholds for messages."""
        functions = zip(self._names, self._thresholds, self._binding, strict=True)
        return ", ".join(f"{name} >= {h:g}" for name, h, binding in functions if binding)

    def _check_said_once(
        self, ids: IntArray, fresh: NDArray[np.bool_], noise: FloatArray | None, run: Trials | None
    ) -> None:
        """TrialError where inputs or noise of one trial are given in two ways; results: see `_filled`."""
        _, first, where = np.unique(ids, return_index=True, return_inverse=True)
        same = first[where]
        if run is not None and not np.array_equal(run.x, run.x[same]):
            raise TrialError("one trial is told twice in this call, with different x")
        if noise is None:
            return
        if not np.array_equal(noise, noise[same], equal_nan=True):
            raise TrialError("one trial is told twice in this call, with different noise")
        told = ids[~fresh]
        other = ~np.isnan(noise[~fresh]) & (noise[~fresh] != self.trials.noise[told])
        if other.any():
            changed = told[other.any(axis=1)]
            raise TrialError(
                f"trials {changed.tolist()[:10]} were told before with another noise; the first result stays"
            )

    def _amended(self, trials: Trials, ids: IntArray, fresh: NDArray[np.bool_], run: Trials) -> Trials:
        """Trials with the inputs of `run`, and what was believed of those, where results are fresh."""
        told = ids[~fresh]
        if not np.array_equal(run.x[~fresh], trials.x[told]):
            changed = told[(run.x[~fresh] != trials.x[told]).any(axis=1)]
            raise TrialError(
                f"trials {changed.tolist()[:10]} were told before with another x; the first result stays"
            )
        columns = ("x", "z", "candidate", "predicted_safe_probability", "violation_bound")
        amended = {}
        for name in columns:
            values = getattr(trials, name).copy()
            values[ids[fresh]] = getattr(run, name)[fresh]
            amended[name] = values
        return replace(trials, **amended)

    def _filled(self, ids: IntArray, results: CheckedResults) -> Trials:
        objective, safety, status = (
            self.trials.objective.copy(),
            self.trials.safety.copy(),
            self.trials.status.copy(),
        )
        for i, trial in enumerate(ids):
            if status[trial] == Status.PENDING:
                objective[trial], safety[trial], status[trial] = (
                    results.objective[i],
                    results.safety[i],
                    results.status[i],
                )
            elif not (
                status[trial] == results.status[i]
                and np.array_equal(objective[trial], results.objective[i], equal_nan=True)
                and np.array_equal(safety[trial], results.safety[i], equal_nan=True)
            ):
                raise TrialError(
                    f"trial {trial} had objective {objective[trial]:g}, safety {safety[trial].tolist()}, "
                    f"status {status[trial]}, and is now told objective {results.objective[i]:g}, safety "
                    f"{results.safety[i].tolist()}, status {results.status[i]}; the first result stays"
                )
        return replace(self.trials, objective=objective, safety=safety, status=status)
