"""Ask and tell: what every optimiser shares.

A proposal travels from the unit cube to a code z, to an input x = decode(z), to the nearest candidate when
only a finite set can be evaluated, and back to the code of that input: models are told of, and safety is
predicted for, the point that will really be evaluated.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdsafebo.errors import NoSafePointError, ProblemError, TrialError
from hdsafebo.gaussian_process import LengthScaleLimits
from hdsafebo.optimizers.ledger import Ledger
from hdsafebo.optimizers.results import check_points, check_results
from hdsafebo.optimizers.settings import OptimizerSettings, check_settings
from hdsafebo.problem import FloatArray, IntArray, Problem, Trials, check_problem
from hdsafebo.search_space import SearchSpace
from hdsafebo.surrogate import (
    DistanceCache,
    Surrogate,
    SurrogateState,
    fit_surrogate,
    modelled_safety,
    modelled_thresholds,
)


class Codec(Protocol):
    """What an optimiser needs of an embedding."""

    def encode(self, x: FloatArray, /) -> FloatArray:
        """(n, D) inputs to (n, d) codes."""

    def decode(self, z: FloatArray, /) -> FloatArray:
        """(n, d) codes to (n, D) inputs."""


@dataclass(frozen=True)
class Proposal:
    """Where a method wants the next trials: k of them, at least one and at most as many as it was asked for.

    Attributes:
        points: (k, d) in the unit cube; None when `rows` are given.
        rows: (k,) rows of the problem's finite candidate set, when the method chose among them itself.
        trust_region_length: of the region the points come from, a number or (k,); NaN without one.
        marked_unsafe: (k,) True for points that are not believed safe; None means that all are.
    """

    points: FloatArray | None = None
    rows: IntArray | None = None
    trust_region_length: float | FloatArray = np.nan
    marked_unsafe: NDArray[np.bool_] | None = None


class Optimizer(ABC):
    """Proposes trials (`ask`) and learns from their results (`tell`).

    Args:
        problem: what is optimised; it is never evaluated from here.
        embedding: map between inputs and the codes that are searched; None searches the inputs themselves.
        seed: of the optimiser's random generator.
        bounds: (2, d) box of codes that is searched. None takes the limits of the codes of the initial trials
            (paper, appendix), or the problem's own bounds when there is no embedding.
        settings: settings of the method by name; see `Settings`.

    Attributes:
        name: name of the method.
        Settings: its settings.
        consults_model: False for methods that never fit a Gaussian process.
        settings: the checked settings.
        rng: the only source of randomness.
        round: number of rounds asked so far.

    Raises:
        ProblemError: the problem or the box is ill-posed.
        ParamsError: a setting is unknown, of the wrong type or out of range.
    """

    name: ClassVar[str]
    Settings: ClassVar[type[OptimizerSettings]] = OptimizerSettings
    consults_model: ClassVar[bool] = True

    def __init__(
        self,
        problem: Problem,
        *,
        embedding: Codec | None = None,
        seed: int = 0,
        bounds: ArrayLike | None = None,
        **settings: Any,
    ) -> None:
        check_problem(problem)
        self.problem = problem
        self.embedding = embedding
        self.settings = check_settings(type(self).Settings, self.name, settings)
        self.rng = np.random.default_rng(seed)
        self.round = 0
        self._space: SearchSpace | None = None
        if bounds is not None:
            self._space = self.make_space(np.asarray(bounds, float))
        elif embedding is None:
            self._space = self.make_space(problem.bounds)
        self._ledger = Ledger(
            problem, problem.bounds.shape[1] if self._space is None else self._space.dimension
        )
        self._elsewhere: IntArray = np.empty(0, np.int64)
        self._cache = DistanceCache()
        self._surrogate: Surrogate | None = None
        self._start: SurrogateState | None = None
        self._next_start: SurrogateState | None = None

    # --- what a method provides

    @abstractmethod
    def propose(self, n: int) -> Proposal:
        """Choose up to n points from what is known (`surrogate`, `trials`, `rng`).

        Raises:
            NoSafePointError: the method abstains.
        """

    def finish_round(self, trials: Trials) -> None:
        """Learn from a round whose results are all known now; they are in `self.trials`, too."""

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """What the method remembers beyond trials, generator and fits: plain data, and arrays by name."""
        return {}, {}

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `method_state` gave."""

    def kernel_inputs(self, trials: Trials) -> FloatArray:
        """(n, p) what the kernel measures distances between, for the points of `trials`."""
        return self.space.kernel_inputs(self.space.to_unit(trials.z))

    def believe(self, trials: Trials) -> tuple[FloatArray, FloatArray]:
        """(n,) safe probabilities and (n,) violation bounds of the points of `trials`, before they are evaluated.

        The bound is NaN when a safety function is modelled through a transform: it would have its units.
        """
        unknown = np.full(len(trials), np.nan)
        if not self.consults_model:
            return unknown, unknown
        inputs = self.kernel_inputs(trials)
        transformed = any(s.modelled and s.transform is not None for s in self.problem.safety)
        bound = unknown if transformed else self.surrogate.violation_bound(inputs, self.settings.confidence)
        return self.surrogate.safe_probability(inputs), bound

    # --- ask, tell, observe

    def ask(self, n: int = 1, *, pending: Trials | None = None) -> Trials:
        """Propose trials.

        Args:
            n: how many.
            pending: trials under evaluation elsewhere, which this optimiser does not know: their candidate rows
                are not proposed. Its own trials without a result are never proposed again anyway.

        Returns:
            At most n trials without results; fewer when the candidates run out, or when the method abstains
            from points that it does not believe safe.

        Raises:
            NoSafePointError: the method abstains altogether.
            TrialError: n is no positive whole number, or every candidate has been proposed.
            SurrogateError: no Gaussian process could be fitted.
        """
        if isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 1:
            raise TrialError(f"n is {n!r}; expected a whole number of trials, at least 1")
        self._elsewhere = np.empty(0, np.int64) if pending is None else pending.candidate
        generator = self.rng.bit_generator.state
        try:
            trials = self._realise(self.propose(min(int(n), self._candidates_left())))
            probability, bound = self.believe(trials)
        except BaseException:
            self.rng.bit_generator.state = generator
            raise
        trials = replace(trials, predicted_safe_probability=probability, violation_bound=bound)
        self._ledger.append(trials)
        self.round += 1
        if self._surrogate is not None:
            self._next_start = self._surrogate.state
        return trials

    def tell(
        self,
        trials: Trials | Sequence[int] | IntArray,
        objective: ArrayLike,
        safety: ArrayLike,
        *,
        status: ArrayLike | None = None,
    ) -> None:
        """Report results of asked trials: all or some of them, in any order.

        Telling the same result again changes nothing. Either everything in the call is taken in, or nothing.

        Args:
            trials: trials from `ask`, or their ids.
            objective: (n,) values.
            safety: (n, m) values, or (n,) when there is one safety function.
            status: (n,) `Status.COMPLETED` or `Status.FAILED`; values of failed trials are ignored. None means
                that all are completed.

        Raises:
            TrialError: an unknown trial, a result that conflicts with an earlier one (which stays), a wrong
                shape, or a value that is no finite number.
        """
        ids = self._ledger.ids_of(trials)
        results = check_results(self.problem, len(ids), objective, safety, status)
        before = self._ledger.trials.status
        finished = self._ledger.record(ids, results)
        if not np.array_equal(before, self._ledger.trials.status):
            self._data_changed()
        for number in finished:
            self.finish_round(self._ledger.round(int(number)))

    def observe(
        self,
        x: ArrayLike,
        objective: ArrayLike,
        safety: ArrayLike,
        *,
        status: ArrayLike | None = None,
        candidate: ArrayLike | None = None,
        initial: bool = False,
    ) -> Trials:
        """Take in results of inputs that were not proposed here: initial data, or trials that someone set by hand.

        Args:
            x: (n, D) inputs.
            objective: (n,) values.
            safety: (n, m) values, or (n,) when there is one safety function.
            status: as in `tell`.
            candidate: (n,) rows of the finite candidate set, -1 for inputs that are not in it; None means no row.
            initial: the data was there before the first `ask`.

        Returns:
            The trials as they were recorded, in round 0.

        Raises:
            TrialError: a wrong shape, a value that is no finite number, or a candidate row that does not exist.
        """
        points = check_points("x", x, self.problem.bounds.shape[1])
        results = check_results(self.problem, len(points), objective, safety, status)
        trials = Trials.pending(
            points,
            self._encode(points),
            len(self.problem.safety),
            first_id=len(self._ledger),
            candidate=self._check_rows(candidate, len(points)),
            initial=np.full(len(points), initial),
            objective=results.objective,
            safety=results.safety,
            status=results.status,
        )
        self._ledger.append(trials)
        self._data_changed()
        return trials

    # --- what is known

    @property
    def trials(self) -> Trials:
        """Everything proposed and observed so far, in the order of the ids."""
        return self._ledger.trials

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """(n,) True for completed trials whose every safety value meets its threshold."""
        return self._ledger.feasible

    def best(self) -> Trials | None:
        """The feasible trial with the highest objective, as a table of one row; None when there is none."""
        row = self._ledger.best_row(self.feasible)
        return None if row is None else self.trials[[row]]

    def centre_row(self) -> int:
        """Row of x* of Algorithm 1, the best feasible trial; without one, that of the least violation.

        Raises:
            NoSafePointError: there is no completed trial, or none is feasible and `empty_safe_set` is "abstain".
        """
        if not self.trials.completed.any():
            raise NoSafePointError(
                f"{self.name} has no completed trial to start from; report initial data with observe(..., initial=True)"
            )
        row = self._ledger.best_row(self.feasible)
        if row is None and self.settings.empty_safe_set == "abstain":
            raise NoSafePointError(
                f"none of the {int(self.trials.completed.sum())} completed trials meets "
                f"{self._ledger.describe_thresholds()}; report a safe trial, or set empty_safe_set to 'mark'"
            )
        return self._ledger.least_violation_row() if row is None else row

    @property
    def space(self) -> SearchSpace:
        """The box that is searched; fixed by the initial trials when no bounds were given.

        Raises:
            NoSafePointError: no bounds were given and nothing has been observed.
        """
        if self._space is None:
            trials = self.trials
            if len(trials) == 0:
                raise NoSafePointError(
                    f"{self.name} has neither bounds nor initial trials to take them from; "
                    "pass bounds, or report initial data with observe(..., initial=True)"
                )
            z = trials.z[trials.initial] if trials.initial.any() else trials.z
            self._space = self.make_space(np.stack([z.min(axis=0), z.max(axis=0)]))
        return self._space

    def make_space(self, bounds: FloatArray) -> SearchSpace:
        """A search space over the given box, with this optimiser's kernel metric."""
        isotropic = self.settings.isotropic
        return SearchSpace(bounds, isotropic=self.embedding is not None if isotropic is None else isotropic)

    @property
    def taken(self) -> IntArray:
        """Rows of the candidate set that were proposed or evaluated, or are under evaluation elsewhere."""
        rows = np.concatenate([self.trials.candidate, self._elsewhere])
        return np.unique(rows[rows >= 0])

    @property
    def surrogate(self) -> Surrogate:
        """Gaussian processes fitted to the completed trials; reading it does not change later proposals.

        Raises:
            NoSafePointError: there is no completed trial.
            SurrogateError: no process could be fitted.
        """
        if self._surrogate is None:
            trials = self.trials[self.rows_to_fit()]
            if len(trials) == 0:
                raise NoSafePointError(
                    f"{self.name} has no completed trial to fit; report initial data with observe"
                )
            self._surrogate = fit_surrogate(
                self.kernel_inputs(trials),
                trials.objective,
                modelled_safety(self.problem.safety, trials.safety),
                modelled_thresholds(self.problem.safety),
                start=self._start,
                cache=self._cache,
                limits=LengthScaleLimits(
                    self.settings.shortest_length_scale, self.settings.longest_length_scale
                ),
            )
        return self._surrogate

    def rows_to_fit(self) -> IntArray:
        """Rows of the completed trials that the surrogate is fitted to: all of them.

        A long campaign bounds its cost by overriding this with, say, the thousand nearest to the centre.
        """
        return np.flatnonzero(self.trials.completed)

    @property
    def model(self) -> Any:
        """The surrogate as a BoTorch `ModelListGP`: objective first, then each modelled safety function.

        Its inputs are codes z (kernel inputs, for methods with kernel inputs of their own); its outputs have
        the units of the outcomes, after each safety function's transform.
        """
        from hdsafebo.botorch_model import to_botorch

        plain = type(self).kernel_inputs is Optimizer.kernel_inputs
        return to_botorch(self.surrogate, self.space if plain else None)

    # --- save and load

    def save(self, path: str | Path) -> None:
        """Write the whole state to one file, atomically; what `load` returns goes on as this optimiser would.

        Raises:
            StateFileError: the file cannot be written.
        """
        from hdsafebo.optimizers.persistence import save_optimizer

        save_optimizer(self, Path(path))

    @classmethod
    def load(cls, path: str | Path, problem: Problem, embedding: Codec | None = None) -> Self:
        """The optimiser of this method that was saved to `path`.

        Raises:
            StateFileError: the file is missing, damaged, or belongs to another method, problem or embedding.
        """
        from hdsafebo.optimizers.persistence import load_optimizer

        return load_optimizer(cls, Path(path), problem, embedding)

    # --- internals

    def _data_changed(self) -> None:
        self._surrogate = None
        if self._next_start is not None:
            self._start, self._next_start = self._next_start, None

    def _candidates_left(self) -> int:
        if self.problem.candidates is None:
            return int(np.iinfo(np.int64).max)
        total = len(self.problem.candidates.features)
        left = total - len(self.taken)
        if left == 0:
            raise TrialError(
                f"all {total} candidates of {self.problem.name!r} have been proposed or evaluated"
            )
        return left

    def _check_rows(self, candidate: ArrayLike | None, n: int) -> IntArray:
        total = 0 if self.problem.candidates is None else len(self.problem.candidates.features)
        rows = np.full(n, -1) if candidate is None else np.asarray(candidate)
        if rows.shape != (n,) or not np.issubdtype(rows.dtype, np.integer):
            raise TrialError(
                f"candidate has shape {rows.shape} and type {rows.dtype}; expected ({n},) whole numbers"
            )
        if n and (rows.min() < -1 or rows.max() >= total):
            raise TrialError(f"candidate holds {rows.min()} to {rows.max()}; expected -1 to {total - 1}")
        return rows.astype(np.int64)

    def _encode(self, x: FloatArray) -> FloatArray:
        z = x.copy() if self.embedding is None else np.asarray(self.embedding.encode(x), float)
        if z.ndim != 2 or len(z) != len(x) or not np.isfinite(z).all():
            raise TrialError(
                f"the embedding gave codes of shape {z.shape} for {len(x)} inputs; expected (n, d) finite numbers"
            )
        return z

    def _realise(self, proposal: Proposal) -> Trials:
        """The trials that a proposal stands for, at the points that will really be evaluated."""
        candidates = self.problem.candidates
        rows = proposal.rows
        if rows is None:
            assert proposal.points is not None, "a proposal has points or rows"
            z = self.space.to_code(proposal.points)
            x = z if self.embedding is None else np.asarray(self.embedding.decode(z), float)
            if candidates is not None:
                rows = candidates.nearest(x, self.taken)
        if rows is None:
            x = np.clip(x, self.problem.bounds[0], self.problem.bounds[1])
            rows = np.full(len(x), -1)
        elif candidates is None:
            raise ProblemError(
                f"{self.name} chose candidate rows, but {self.problem.name!r} has no candidate set"
            )
        else:
            x = candidates.inputs(rows)
        n = len(x)
        return Trials.pending(
            x,
            self._encode(x),
            len(self.problem.safety),
            first_id=len(self._ledger),
            round=self.round + 1,
            candidate=np.asarray(rows, np.int64),
            trust_region_length=np.broadcast_to(np.asarray(proposal.trust_region_length, float), (n,)).copy(),
            marked_unsafe=np.zeros(n, bool)
            if proposal.marked_unsafe is None
            else np.asarray(proposal.marked_unsafe, bool),
        )
