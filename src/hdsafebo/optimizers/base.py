"""Ask and tell: what every optimiser shares.

A proposal travels from the unit cube to a code z and to an input x = decode(z). When only a finite set can be
evaluated it goes on to the nearest candidate and back to the code of that: models are told of, and safety is
predicted for, the point that will really be evaluated.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from threading import RLock
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdsafebo.errors import NoSafePointError, TrialError
from hdsafebo.gp.fit import LengthScaleLimits, NoisePrior
from hdsafebo.gp.surrogate import (
    DistanceCache,
    Surrogate,
    SurrogateState,
    fit_surrogate,
    modelled_safety,
    modelled_thresholds,
)
from hdsafebo.optimizers.core.fits import FitCounts, Fits
from hdsafebo.optimizers.core.ledger import Ledger
from hdsafebo.optimizers.core.nearest_trials import rows_near_best
from hdsafebo.optimizers.core.persistence import load_optimizer, save_optimizer
from hdsafebo.optimizers.core.proposal import Proposal, candidates_left, encode, realise
from hdsafebo.optimizers.core.results import check_points, check_results, check_rows
from hdsafebo.optimizers.core.transaction import all_or_nothing, one_at_a_time
from hdsafebo.optimizers.settings import CentreSettings, ModelSettings, OptimizerSettings, check_settings
from hdsafebo.problem import Codec, Problem, check_problem
from hdsafebo.search.metric import Metric, kernel_metric
from hdsafebo.search.space import SearchSpace
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray, IntArray

_ATTEMPTS = 20
"""Proposals after which a method abstains when none of them is believed safe where it would be evaluated."""


class Optimizer(ABC):
    """Proposes trials (`ask`) and learns from their results (`tell`).

    Several threads may use one optimiser: calls that change it wait for each other. A call that fails or is
    interrupted leaves it as it was.

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
        consults_model: the method has the settings of the Gaussian processes (`ModelSettings`), and says of
            each trial what they believe.
        uses_initial_data: False for methods that ask for initial trials of their own.
        uses: what a task gives and the method can use, as `problems.knowledge.Knowledge` names it.
        settings: the checked settings.
        rng: the only source of randomness.
        round: number of rounds asked so far.
        elsewhere: rows of the candidate set that are under evaluation elsewhere.

    Raises:
        ProblemError: the problem or the box is ill-posed.
        ParamsError: a setting is unknown, of the wrong type or out of range.
    """

    name: ClassVar[str]
    Settings: ClassVar[type[OptimizerSettings]] = OptimizerSettings
    consults_model: ClassVar[bool] = False
    uses_initial_data: ClassVar[bool] = True
    uses: ClassVar[frozenset[str]] = frozenset({"latent_space", "kernel_features", "safety", "extra_trials"})

    def __init_subclass__(cls) -> None:
        cls.consults_model = issubclass(cls.Settings, ModelSettings)

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
        self._metric: Metric | None = None
        if bounds is not None or embedding is None:
            self._space = self.make_space(problem.bounds if bounds is None else np.asarray(bounds, float))
        self._ledger = Ledger(
            problem, problem.bounds.shape[1] if self._space is None else self._space.dimension
        )
        self.elsewhere: IntArray = np.empty(0, np.int64)
        self._fits = Fits()
        self._lock: AbstractContextManager[bool] = RLock()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._lock = RLock()  # a copy is used on its own

    # --- what a method provides

    @abstractmethod
    def propose(self, n: int) -> Proposal:
        """Choose up to n points from what is known (`surrogate`, `trials`, `rng`).

        Raises:
            NoSafePointError: the method abstains.
        """

    def finish_round(self, trials: Trials) -> None:  # noqa: B027 (a method may have nothing to learn)
        """Learn from a round whose results are all known now; they are in `self.trials`, too."""

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """What the method remembers beyond trials, generator and fits: plain data, and arrays by name."""
        return {}, {}

    def restore_method_state(  # noqa: B027 (a method may have nothing to remember)
        self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]
    ) -> None:
        """Take back what `method_state` gave."""

    def kernel_inputs(self, trials: Trials) -> FloatArray:
        """(n, p) what the kernel measures distances between, for the points of `trials`."""
        if self.problem.features is not None:
            return np.asarray(self.problem.features(trials.x), float)
        return self.space.kernel_inputs(self.space.to_unit(trials.z))

    def inputs_of(self, points: FloatArray) -> FloatArray:
        """(k, p) what the kernel measures distances between, for (k, d) points of the unit cube."""
        return (
            self.space.kernel_inputs(points) if self.problem.features is None else self.metric.inputs(points)
        )

    @property
    def metric(self) -> Metric:
        """From the unit cube to kernel inputs.

        Raises:
            ProblemError: the problem's features are no affine map of the codes.
        """
        if self._metric is None:
            self._metric = kernel_metric(self.problem, self.embedding, self.space)
        return self._metric

    def begin_day(  # noqa: B027 (a method may know of no drift)
        self, day: int, earlier: IntArray | None = None
    ) -> None:
        """Trials from now on are of another day, between which outcomes drift.

        Args:
            day: number of the day.
            earlier: (n,) days of all trials so far; None keeps what is known of them.
        """

    def in_units(self, mean: FloatArray, deviation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(k,) predictions of the objective's model, mean and deviation, in units of the objective."""
        return mean, deviation

    def believe(self, trials: Trials) -> tuple[FloatArray, FloatArray]:
        """(n,) safe probabilities and (n,) violation bounds of the points of `trials`, not yet evaluated.

        The bound is NaN when a safety function is modelled through a transform: it would have its units.
        """
        unknown = np.full(len(trials), np.nan)
        if not self.consults_model:
            return unknown, unknown
        inputs = self.kernel_inputs(trials)
        transformed = any(s.modelled and s.transform is not None for s in self.problem.safety)
        beta = self.model_settings.confidence
        bound = unknown if transformed else self.surrogate.violation_bound(inputs, beta)
        return self.surrogate.safe_probability(inputs), bound

    @property
    def confidence(self) -> float:
        """The beta of the safe set."""
        return self.model_settings.confidence

    def keeps_promise(self, trials: Trials) -> NDArray[np.bool_]:
        """(n,) True for trials that are in the method's safe set where they will be evaluated.

        Methods without a safe set promise nothing.
        """
        if not (self.consults_model and isinstance(self.settings, CentreSettings)):
            return np.ones(len(trials), bool)
        return self.surrogate.believed_safe(self.kernel_inputs(trials), self.confidence)

    # --- ask, tell, observe

    @all_or_nothing
    def ask(self, n: int = 1, *, pending: Trials | None = None) -> Trials:
        """Propose trials.

        Args:
            n: how many.
            pending: trials under evaluation elsewhere, which this optimiser does not know: their candidate
                rows are not proposed. Its own trials without a result are never proposed again anyway.

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
        self.elsewhere = np.empty(0, np.int64) if pending is None else pending.candidate
        if candidates_left(self.problem, self.taken) == 0:
            total = len(self.taken)
            raise TrialError(f"all {total} candidates of {self.problem.name!r} have been proposed or tried")
        trials = self._next_trials(int(n))
        self._ledger.append(trials)
        self.round += 1
        self._fits.use()
        return trials

    @all_or_nothing
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
            safety: (n, m) values, or (n,) when there is one safety function; or a table (DataFrame, mapping)
                with a column for each, which its name finds.
            status: (n,) `Status.COMPLETED` or `Status.FAILED`; values of failed trials are ignored. None
                means that all are completed.

        Raises:
            TrialError: an unknown trial, a result that conflicts with an earlier one (which stays), a wrong
                shape, or a value that is no finite number.
        """
        ids = self._ledger.ids_of(trials)
        results = check_results(self.problem, len(ids), objective, safety, status)
        before = self._ledger.trials.status
        finished = self._ledger.record(ids, results)
        if not np.array_equal(before, self._ledger.trials.status):
            self._fits.forget()
        for number in finished:
            self.finish_round(self._ledger.round(int(number)))

    @all_or_nothing
    def observe(
        self,
        x: ArrayLike,
        objective: ArrayLike,
        safety: ArrayLike,
        *,
        status: ArrayLike | None = None,
        candidate: ArrayLike | None = None,
        codes: ArrayLike | None = None,
        initial: bool = False,
    ) -> Trials:
        """Take in results of inputs not proposed here (initial data, trials set by hand), as of round 0.

        Args:
            x: (n, D) inputs.
            objective: (n,) values.
            safety: as in `tell`.
            status: as in `tell`.
            candidate: (n,) rows of the finite candidate set, -1 for inputs not in it; None means no row.
            codes: (n, d) codes that the inputs were decoded from; rows of NaN, and None, are encoded.
            initial: the data was there before the first `ask`.

        Raises:
            TrialError: a wrong shape, a value that is no finite number, or a row that does not exist or has
                another input.
        """
        points = check_points("x", x, self.problem.bounds.shape[1])
        results = check_results(self.problem, len(points), objective, safety, status)
        trials = Trials.pending(
            points,
            encode(self.embedding, points, codes),
            len(self.problem.safety),
            first_id=len(self._ledger),
            candidate=check_rows(self.problem, candidate, points),
            initial=np.full(len(points), initial),
            objective=results.objective,
            safety=results.safety,
            status=results.status,
        )
        self._ledger.append(trials)
        self._fits.forget()
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
            NoSafePointError: no trial is completed, or none is feasible and `empty_safe_set` is "abstain".
        """
        if not self.trials.completed.any():
            raise NoSafePointError(
                f"{self.name} has no completed trial to start from; "
                "report initial data with observe(..., initial=True)"
            )
        row = self._ledger.best_row(self.feasible)
        if row is None and self._abstains:
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
        isotropic = self.model_settings.isotropic
        return SearchSpace(bounds, isotropic=self.embedding is not None if isotropic is None else isotropic)

    @property
    def taken(self) -> IntArray:
        """Rows of the candidate set that were proposed or evaluated, or are under evaluation elsewhere."""
        rows = np.concatenate([self.trials.candidate, self.elsewhere])
        return np.unique(rows[rows >= 0])

    def refit(self) -> None:
        """Fit the surrogate anew when it is next needed: what it is fitted to has changed."""
        self._fits.forget()

    @property
    def model_settings(self) -> ModelSettings:
        """Settings of the Gaussian processes; their defaults for a method that does not consult them."""
        return self.settings if isinstance(self.settings, ModelSettings) else ModelSettings()

    @property
    @one_at_a_time
    def surrogate(self) -> Surrogate:
        """Gaussian processes fitted to the completed trials; reading it does not change later proposals.

        Raises:
            NoSafePointError: there is no completed trial.
            SurrogateError: no process could be fitted.
        """
        return self._fits.current(self._fit)

    def _fit(self, start: SurrogateState | None, cache: DistanceCache) -> Surrogate:
        rows = self.rows_to_fit()
        if len(rows) == 0:
            raise NoSafePointError(f"{self.name} has no completed trial to fit; report data with observe")
        trials, settings = self.trials[rows], self.model_settings
        return fit_surrogate(
            self.kernel_inputs(trials),
            self.outcomes_to_fit(rows),
            modelled_safety(self.problem.safety, trials.safety),
            modelled_thresholds(self.problem.safety),
            start=start,
            cache=cache,
            limits=LengthScaleLimits(settings.shortest_length_scale, settings.longest_length_scale),
            noise=self.noise_prior,
            refine=self.refines(),
        )

    @property
    def noise_prior(self) -> NoisePrior:
        """What is known beforehand of the noise of all functions."""
        return NoisePrior()

    def refines(self) -> bool:
        """Whether a fit searches hyper-parameters, or keeps those of the fit before."""
        return True

    def outcomes_to_fit(self, rows: IntArray) -> FloatArray:
        """(k,) what the objective's process is fitted to, of the completed trials `rows`."""
        return self.trials.objective[rows]

    def rows_to_fit(self) -> IntArray:
        """Rows of the completed trials that the surrogate is fitted to: all, or those near the best."""
        return rows_near_best(self._ledger, self.kernel_inputs, self.model_settings.max_fitted_trials)

    @property
    def certified_points(self) -> int | None:
        """Most points of its own discretisation that the method certified in a round; None without one."""
        return None

    @property
    def fit_counts(self) -> FitCounts:
        """Fits that rounds were asked with so far, and how many of them were in numerical trouble."""
        return self._fits.counts

    @property
    def model(self) -> Any:
        """The surrogate as a BoTorch `ModelListGP`: objective first, then each modelled safety function.

        Its inputs are codes z (kernel inputs, for methods with kernel inputs of their own); its outputs have
        the units of the outcomes, after each safety function's transform.
        """
        from hdsafebo.optimizers.core.botorch_model import to_botorch

        plain = type(self).kernel_inputs is Optimizer.kernel_inputs and self.problem.features is None
        return to_botorch(self.surrogate, self.space if plain else None)

    # --- save and load

    @one_at_a_time
    def save(self, path: str | Path) -> None:
        """Write the whole state to one file, atomically; what `load` returns goes on as this optimiser would.

        Raises:
            StateFileError: the file cannot be written.
        """
        save_optimizer(self, Path(path))

    @classmethod
    def load(cls, path: str | Path, problem: Problem, embedding: Codec | None = None) -> Self:
        """The optimiser of this method that was saved to `path`.

        Raises:
            StateFileError: the file is missing, damaged, or belongs to another method, problem or embedding.
        """
        return load_optimizer(cls, Path(path), problem, embedding)

    # --- from a proposal to trials

    @property
    def _abstains(self) -> bool:
        return isinstance(self.settings, CentreSettings) and self.settings.empty_safe_set == "abstain"

    def _next_trials(self, n: int) -> Trials:
        """Trials of a proposal, each believed safe where it will be evaluated, or marked, or left out.

        A proposal may have been moved since the method judged it: to the nearest candidate, or to where an
        embedding permits.
        """
        for _ in range(_ATTEMPTS):
            left = candidates_left(self.problem, self.taken)
            if left == 0:
                break
            trials = self._realised(self.propose(min(n, left)))
            broken = ~trials.marked_unsafe & ~self.keeps_promise(trials)
            if not self._abstains:
                return replace(trials, marked_unsafe=trials.marked_unsafe | broken)
            if not broken.all():
                kept = trials[~broken]
                return replace(kept, id=len(self._ledger) + np.arange(len(kept)))
            self.elsewhere = np.concatenate([self.elsewhere, trials.candidate])
        raise NoSafePointError(
            f"{self.name} believes nothing safe where it would be evaluated; report more trials near a safe "
            "one, choose a larger beta (or a smaller alpha), or set empty_safe_set to 'mark'"
        )

    def _realised(self, proposal: Proposal) -> Trials:
        """The trials that a proposal stands for, with what is believed of them."""
        trials = realise(
            proposal,
            self.problem,
            self.embedding,
            self.space,
            taken=self.taken,
            first_id=len(self._ledger),
            round=self.round + 1,
        )
        probability, bound = self.believe(trials)
        return replace(trials, predicted_safe_probability=probability, violation_bound=bound)
