"""A study: suggestions for one's own system, in its own names and units, kept in a folder.

study = Study.open("arm.hdsafebo", system)        # begins or goes on
study.observe(table)                              # what was tried already
suggestion = study.ask(context={"payload": 1.2})
study.tell(suggestion, run(**suggestion.setting))
"""

from __future__ import annotations

import threading
import uuid
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hdsafebo.errors import HdSafeBOError, NoSafePointError, OptimisticWarning
from hdsafebo.optimizers.registry import load_optimizer, make_optimizer
from hdsafebo.system import beliefs, reading
from hdsafebo.system.beliefs import Belief, Best
from hdsafebo.system.description import System
from hdsafebo.system.errors import StudyError, TableError
from hdsafebo.system.problem import SystemProblem
from hdsafebo.system.reading import Suggestion
from hdsafebo.system.storage import Folder, Plan, check_same
from hdsafebo.system.tables import STATUS, columns_of, measured, require, result_names
from hdsafebo.trials import Status

if TYPE_CHECKING:
    import pandas as pd

    from hdsafebo.optimizers.base import Optimizer
    from hdsafebo.system.tables import Table


class Study:
    """A study in memory; `Study.open` keeps it in a folder.

    Args:
        system: what is optimised.
        method: name of the optimiser (`hdsafebo methods` lists them).
        seed: of its random generator.
        settings: of the method, such as `alpha` (the safe probability that every suggestion is promised).

    Attributes:
        system: what is optimised.
        method: name of the optimiser.
        seed: of its random generator.
        settings: of the method.
        identity: the folder's path, or a random text for a study in memory.

    Raises:
        DescriptionError: the system is incomplete or contradicts itself.
        ProblemError: the method cannot do what the system needs.
        ParamsError: a setting is unknown, of the wrong type or out of range.
    """

    def __init__(
        self, system: System, *, method: str = "hdsafebo_local", seed: int = 0, **settings: Any
    ) -> None:
        self._begin(system, Plan(method, seed, settings), None)

    @classmethod
    def open(
        cls,
        path: str | Path,
        system: System | None = None,
        *,
        method: str | None = None,
        seed: int | None = None,
        **settings: Any,
    ) -> Study:
        """Begin a study in a folder, or go on with the one that is there.

        Each step is on the disk when it returns, whatever happens afterwards; several processes may have the
        same study open and take turns.

        Args:
            path: the folder.
            system: what is optimised; may be left out when the study exists.
            method: as in `Study`; may be left out when the study exists.
            seed: likewise.
            settings: likewise.

        Raises:
            StudyError: there is no study and no system to begin one with, the study is of another system,
                method, seed or settings, or its files are damaged.
        """
        folder = Folder(Path(path))
        if not folder.exists:
            if system is None:
                raise StudyError(f"{path}: no study is there; pass the system to begin one")
            plan = Plan(method or "hdsafebo_local", seed or 0, settings)
            begun = cls.__new__(cls)
            begun._begin(system, plan, None)  # what cannot be begun leaves no folder
            kept = begun._optimizer.settings.model_dump(mode="json", exclude_unset=True)
            folder.create(system, Plan(plan.method, plan.seed, kept), begun._optimizer.save)
        stored, plan = folder.read()
        for key, value, known in (("method", method, plan.method), ("seed", seed, plan.seed)):
            if value is not None and value != known:
                raise StudyError(f"{path}: {key} of the study is {known!r}; expected {value!r}")
        if system is not None:
            check_same(path, stored.to_dict(), system.to_dict())
        study = cls.__new__(cls)
        study._begin(stored, plan, folder)
        folder.check_given(study._settings, settings)
        with study._current():
            folder.clean()
        return study

    def _begin(self, system: System, plan: Plan, folder: Folder | None) -> None:
        self.system, self.method = system, plan.method
        self.seed, self.settings = plan.seed, dict(plan.settings)
        self.identity = uuid.uuid4().hex if folder is None else str(folder.path.resolve())
        self._plan, self._folder = plan, folder
        self._turn = threading.RLock()
        self._new()

        from hdsafebo.optimizers.settings import SafeSetSettings

        if not isinstance(self._optimizer.settings, SafeSetSettings):
            warnings.warn(
                f"{self.method} promises no safety: it suggests settings whatever their safe probability, "
                "which is shown with each; methods that promise it: hdsafebo_local, linebo_lower, safeopt",
                OptimisticWarning,
                stacklevel=3,
            )

    def _new(self) -> None:
        self._problem = SystemProblem(self.system)
        self._optimizer: Optimizer = make_optimizer(
            self._plan.method, self._problem, seed=self._plan.seed, **self._plan.settings
        )
        self._settings = self._optimizer.settings

    # --- steps

    def ask(self, n: int | None = None, *, context: Mapping[str, Any] | None = None) -> Any:
        """Suggest trials.

        Args:
            n: how many; None asks for one.
            context: value of every context, by name.

        Returns:
            A `Suggestion` without n; with n a DataFrame of at most n trials, indexed by trial, with the
            columns of parameters and contexts, `safe_probability` and `marked_unsafe`.

        Raises:
            TableError: a context is missing, unknown or out of range.
            NoSafePointError: nothing is believed safe; the message says what to do.
        """
        held = reading.context_columns(self._problem.codec, context)
        with self._step() as optimizer:
            try:
                trials = optimizer.ask(1 if n is None else n, context=held)
            except NoSafePointError as error:
                advice = beliefs.what_is_safest(optimizer, held if self.system.contexts else None)
                raise NoSafePointError(f"{error}{advice}") from None
            trials = beliefs.with_probabilities(optimizer, trials)
        if n is not None:
            return reading.suggested(self._problem.codec, trials)
        known = {c.name for c in self.system.contexts}
        values = self._problem.codec.records(trials.x)[0]
        return Suggestion(
            int(trials.id[0]),
            {name: v for name, v in values.items() if name not in known},
            {name: v for name, v in values.items() if name in known},
            float(trials.predicted_safe_probability[0]),
            bool(trials.marked_unsafe[0]),
        )

    def tell(
        self,
        trial: Any,
        results: Table | None = None,
        *,
        ran: Mapping[str, Any] | None = None,
        failed: bool = False,
        noise: Mapping[str, float] | None = None,
    ) -> None:
        """Report the result of one trial, or of a table of trials.

        Either everything in the call is taken in, or nothing. The same result told again changes nothing.

        Args:
            trial: a `Suggestion`, the id of a trial, or a table with the column (or index) `trial`, the
                outcomes, and optionally `status` and `<outcome>_noise`; a table may have the inputs, too,
                which are then what was really run.
            results: outcomes by name, of a single trial.
            ran: parameters and contexts that were really set, where they differ from what was asked.
            failed: the trial gave no result; no outcomes are needed.
            noise: known standard deviations of the outcomes, by name.

        Raises:
            TableError: a name is missing or unknown, or a value is out of range or no finite number.
            TrialError: an unknown trial, or a result that conflicts with an earlier one, which stays.
        """
        if isinstance(trial, bool | np.bool_):  # Python takes True for the number 1
            raise TableError(f"trial is {trial!r}; expected a suggestion, its number or a table")
        if isinstance(trial, Suggestion | int | np.integer):
            number = trial.trial if isinstance(trial, Suggestion) else int(trial)
            ids = [number]
            columns = reading.results_of_one(self.system, results, failed, noise)
            instead: dict[str, Any] = dict(reading.one_of_each(ran, "ran"))
            require(instead, [], self.system.inputs, "ran")
        else:
            if results is not None or ran is not None or noise is not None or failed:
                raise TableError(
                    "a table of trials holds all that is told of them; leave the other arguments out"
                )
            ids, columns = reading.results_of_many(self.system, trial)
            instead = {n: columns.pop(n) for n in self.system.inputs if n in columns}
        told = measured(self.system, columns, len(ids))
        with self._step() as optimizer:
            if isinstance(trial, Suggestion) and not instead:
                reading.check_asked(self._problem.codec, optimizer.trials, trial)
            x = reading.inputs_run(self._problem.codec, optimizer.trials.x, ids, instead)
            optimizer.tell(ids, told.objective, told.safety, status=told.status, x=x, noise=told.noise)

    def observe(self, table: Table) -> None:
        """Take in trials that were not suggested here: what was tried before, or set by hand since.

        Args:
            table: the columns are parameters, contexts and outcomes, and optionally `status` ("completed" or
                "failed") and `<outcome>_noise`. Values between steps are taken as they were set.

        Raises:
            TableError: a column is missing or unknown, or a value is out of range or no finite number.
        """
        columns = columns_of(table, "the table")
        fixed = [p.name for p in self.system.parameters if p.width == 0]
        needed = [name for name in self.system.inputs if name not in fixed]
        outcomes = [] if STATUS in columns else list(self.system.outcomes)
        require(columns, [*needed, *outcomes], [*fixed, *result_names(self.system)], "the table")
        n = len(next(iter(columns.values())))
        x = reading.encoded(self._problem.codec, columns, n)
        told = measured(self.system, columns, n)
        with self._step() as optimizer:
            trials = beliefs.pending(optimizer, x)
            optimizer.observe(
                trials.x,
                told.objective,
                told.safety,
                status=told.status,
                noise=told.noise,
                candidate=trials.candidate,
                initial=optimizer.round == 0,
            )

    # --- what is known and believed

    def predict(self, table: Table, *, context: Mapping[str, Any] | None = None) -> pd.DataFrame:
        """What is believed of settings, in the user's units; see `beliefs.predict` for the columns.

        Args:
            table: settings, with the contexts that `context` does not give for all of them.
            context: values of contexts, by name.

        Raises:
            TableError: a column is missing or unknown, or a value is out of range.
            NoSafePointError: nothing was told yet.
        """
        columns = columns_of(table, "the table")
        n = len(next(iter(columns.values()), []))
        columns = reading.with_context(self.system, columns, context, n)
        fixed = [p.name for p in self.system.parameters if p.width == 0]
        require(columns, [name for name in self.system.inputs if name not in fixed], fixed, "the table")
        with self._current() as optimizer:
            return beliefs.predict(optimizer, reading.encoded(self._problem.codec, columns, n))

    def best(self, *, context: Mapping[str, Any] | None = None) -> Best | None:
        """The best setting as measured and as believed, of those that kept every limit; None without one.

        Args:
            context: under which settings are compared; None compares each under its own.
        """
        held = None if context is None else reading.context_columns(self._problem.codec, context)
        with self._current() as optimizer:
            return beliefs.best(optimizer, held)

    def safest(self, *, context: Mapping[str, Any] | None = None) -> Belief | None:
        """The setting most probably safe of those that kept every limit; None without one.

        What to run again where nothing new is believed safe.

        Args:
            context: under which it would be run; None takes each trial under its own.
        """
        held = None if context is None else reading.context_columns(self._problem.codec, context)
        with self._current() as optimizer:
            return beliefs.safest(optimizer, held)

    def expected_gain(self, *, context: Mapping[str, Any] | None = None) -> float:
        """How much one more trial is expected to improve on the believed best, in the objective's units.

        Stop when it is less than a trial costs.
        """
        held = reading.context_columns(self._problem.codec, context)
        with self._current() as optimizer:
            return beliefs.expected_gain(optimizer, held if self.system.contexts else None)

    def to_dataframe(self) -> pd.DataFrame:
        """All trials, one row each, indexed by trial, in the user's names and units.

        Columns: parameters, contexts, outcomes, `status`, `safe` (every limit was kept), `initial`, `round`,
        `safe_probability` (as believed before the trial), `marked_unsafe`.
        """
        with self._current() as optimizer:
            return reading.history(self._problem, optimizer.trials, optimizer.feasible)

    def to_csv(self, path: str | Path) -> None:
        """Write `to_dataframe` to a file, whole or not at all."""
        from hdsafebo.files.atomic import replacing

        with replacing(Path(path)) as temporary:
            self.to_dataframe().to_csv(temporary)

    def pending(self) -> pd.DataFrame:
        """Trials that were asked and not told; of methods without a model no probability is kept (NaN)."""
        with self._current() as optimizer:
            trials = optimizer.trials
            return reading.suggested(self._problem.codec, trials[trials.status == Status.PENDING])

    @property
    def optimizer(self) -> Optimizer:
        """The optimiser, which sees the box [0, 1]^D; change it through the study only."""
        with self._current() as optimizer:
            return optimizer

    def __len__(self) -> int:
        return len(self.optimizer.trials)

    def __repr__(self) -> str:
        where = "" if self._folder is None else f" in {str(self._folder.path)!r}"
        return f"Study of {self.system.name!r} by {self.method}{where}, {len(self)} trials"

    # --- turns

    @contextmanager
    def _current(self) -> Iterator[Optimizer]:
        """The optimiser as the last step of any process left it."""
        with self._turn:
            if self._folder is None:
                yield self._optimizer
                return
            with self._folder.locked(looking=True):
                self._refresh(self._folder)
                yield self._optimizer

    @contextmanager
    def _step(self) -> Iterator[Optimizer]:
        """A step: on the disk when it ends, and no step at all when it fails."""
        with self._turn:
            if self._folder is None:
                yield self._optimizer
                return
            with self._folder.locked():
                self._refresh(self._folder)
                try:
                    yield self._optimizer
                    self._optimizer.save(self._folder.state)
                except BaseException:
                    self._folder.forget()
                    raise
                self._folder.note()

    def _refresh(self, folder: Folder) -> None:
        folder.require_state()
        if not folder.changed:
            return
        if folder.begun:
            self._problem = SystemProblem(self.system)
            try:
                self._optimizer = load_optimizer(self._plan.method, folder.state, self._problem)
            except HdSafeBOError as error:
                raise StudyError(f"{folder.path}: {error}") from error
            folder.check_settings(self._plan, self._settings, self._optimizer.settings)
        else:
            self._new()
        folder.note()
