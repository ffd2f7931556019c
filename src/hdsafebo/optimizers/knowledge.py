"""What an optimiser knows and believes, and what a method may make of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from threading import RLock
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdsafebo.errors import NoSafePointError
from hdsafebo.gp.fit import NoisePrior
from hdsafebo.gp.surrogate import Beliefs, DistanceCache
from hdsafebo.optimizers.core.contexts import check_able, in_context, novel_beta
from hdsafebo.optimizers.core.fits import FitCounts, Fits, State, fit_trials
from hdsafebo.optimizers.core.ledger import Ledger
from hdsafebo.optimizers.core.nearest_trials import rows_near_best
from hdsafebo.optimizers.core.proposal import Proposal
from hdsafebo.optimizers.core.transaction import one_at_a_time
from hdsafebo.optimizers.settings import (
    CentreSettings,
    ModelSettings,
    OptimizerSettings,
    check_settings,
    constructor_signature,
    warn_of_an_optimistic_default,
)
from hdsafebo.problem import Codec, ContextualSet, Problem, check_problem, features_of
from hdsafebo.search.metric import Metric, kernel_metric
from hdsafebo.search.space import SearchSpace
from hdsafebo.trials import Trial, Trials
from hdsafebo.typing import FloatArray, IntArray

S = TypeVar("S", bound=OptimizerSettings)


class Knowledge(ABC, Generic[S]):
    """Trials, the searched box and the fitted model of one optimiser; see `base.Optimizer`, which is one."""

    name: ClassVar[str]
    Settings: ClassVar[type[OptimizerSettings]] = OptimizerSettings
    consults_model: ClassVar[bool] = False
    uses_initial_data: ClassVar[bool] = True
    holds_contexts: ClassVar[bool] = False
    searches_codes: ClassVar[bool] = True
    uses: ClassVar[frozenset[str]] = frozenset({"latent_space", "kernel_features", "safety", "extra_trials"})

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.consults_model = issubclass(cls.Settings, ModelSettings)
        cls.__signature__ = constructor_signature(cls.__init__, cls.Settings)  # type: ignore[attr-defined]

    def __init__(
        self,
        problem: Problem,
        *,
        embedding: Codec | None = None,
        seed: int = 0,
        bounds: ArrayLike | None = None,
        settings: S | None = None,
        **keywords: Any,
    ) -> None:
        check_problem(problem)
        self.problem = problem
        self.codec = embedding
        self.embedding = embedding if self.searches_codes else None
        box = bounds if self.searches_codes else None
        check_able(self.name, self.holds_contexts, problem, self.embedding)
        self.settings: S = check_settings(type(self).Settings, self.name, settings, keywords)  # type: ignore[assignment]
        warn_of_an_optimistic_default(self.name, self.settings)
        self.rng = np.random.default_rng(seed)
        self.round = 0
        self._space: SearchSpace | None = None
        self._metric: Metric | None = None
        if box is not None or self.embedding is None:
            self._space = self.make_space(problem.bounds if box is None else np.asarray(box, float))
        self._context = np.zeros(len(problem.contexts))
        self._ledger = Ledger(
            problem, problem.bounds.shape[1] if self._space is None else self._space.dimension
        )
        self.elsewhere: IntArray = np.empty(0, np.int64)
        self._fits = Fits()
        self._lock: AbstractContextManager[bool] = RLock()
        self.prepare()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._lock = RLock()  # a copy is used on its own

    # --- what a method provides

    def prepare(self) -> None:
        """Set up what the method remembers; called once, when everything else is there.

        Raises:
            ProblemError, ParamsError: the method cannot do what the problem or the settings ask.
        """

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
        if self.problem.features is not None:
            return features_of(self.problem, trials.x)
        return self.space.kernel_inputs(self.space.to_unit(trials.z))

    def inputs_of(self, rows: IntArray) -> FloatArray:
        """(k, p) `kernel_inputs` of the given rows of `trials`."""
        return self.kernel_inputs(self.trials[rows])

    def inputs_at(self, points: FloatArray) -> FloatArray:
        """(k, p) what the kernel measures distances between, for (k, d) points of the unit cube."""
        plain = self.problem.features is None
        return self.space.kernel_inputs(points) if plain else self.metric.inputs(points)

    @property
    def metric(self) -> Metric:
        """From the unit cube to kernel inputs.

        Raises:
            ProblemError: the problem's features are no affine map of the codes.
        """
        if self._metric is None:
            self._metric = kernel_metric(self.problem, self.embedding, self.space)
        return self._metric

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
        return rows_near_best(self._ledger, self.inputs_of, self.model_settings.max_fitted_trials)

    def begin_day(self, day: int, earlier: IntArray | None = None) -> None:
        """Trials from now on are of another day, between which outcomes drift.

        Args:
            day: number of the day.
            earlier: (n,) days of all trials so far; None keeps what is known of them.
        """

    def in_units(self, mean: FloatArray, deviation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(k,) predictions of the objective's model, mean and deviation, in units of the objective."""
        return mean, deviation

    # --- what is promised

    @property
    def confidence(self) -> float:
        """The beta of the safe set."""
        return self.promised_beta

    @property
    def promised_beta(self) -> float:
        """The beta that was set, lowered under contexts that few trials have reached."""
        beta = self.model_settings.confidence
        return novel_beta(beta, self.trials, self.problem.contexts, self._context)

    def keeps_promise(self, trials: Trials) -> NDArray[np.bool_]:
        """(n,) True for trials that are in the method's safe set where they will be evaluated.

        Methods without a safe set promise nothing.
        """
        if not (self.consults_model and isinstance(self.settings, CentreSettings)):
            return np.ones(len(trials), bool)
        return self.surrogate.believed_safe(self.kernel_inputs(trials), self.confidence)

    @property
    def _abstains(self) -> bool:
        return isinstance(self.settings, CentreSettings) and self.settings.empty_safe_set == "abstain"

    # --- what is known

    @property
    def trials(self) -> Trials:
        """Everything proposed and observed so far, in the order of the ids."""
        return self._ledger.trials

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """(n,) True for completed trials whose every safety value meets its threshold."""
        return self._ledger.feasible

    def best(self) -> Trial | None:
        """The feasible trial with the highest objective; None when there is none."""
        row = self._ledger.best_row(self.feasible)
        return None if row is None else self.trials.one(row)

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
        if row is not None and self.problem.contexts:
            row = self._best_in_context()
        if row is None and self._abstains:
            raise NoSafePointError(
                f"none of the {int(self.trials.completed.sum())} completed trials meets "
                f"{self._ledger.describe_thresholds()}; report a safe trial, or set empty_safe_set to 'mark'"
            )
        return self._ledger.least_violation_row() if row is None else row

    @property
    def taken(self) -> IntArray:
        """Rows of the candidate set that were proposed or evaluated, or are under evaluation elsewhere.

        Under other contexts a row is another input.
        """
        columns = list(self.problem.contexts)
        same = (self.trials.x[:, columns] == self._context).all(axis=1)
        rows = np.concatenate([self.trials.candidate[same], self.elsewhere])
        return np.unique(rows[rows >= 0])

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
        """A search space over the given box.

        The kernel divides all code dimensions by one number, as Proposition 3 of the paper needs, and the
        problem's own inputs each by its width.
        """
        return SearchSpace(
            bounds,
            isotropic=self.embedding is not None,
            land=self.problem.land if self.problem.lands else None,
        )

    # --- what is believed

    @property
    def model_settings(self) -> ModelSettings:
        """Settings of the Gaussian processes; their defaults for a method that does not consult them."""
        return self.settings if isinstance(self.settings, ModelSettings) else ModelSettings()

    @property
    @one_at_a_time
    def surrogate(self) -> Beliefs:
        """Gaussian processes fitted to the completed trials; reading it does not change later proposals.

        Raises:
            NoSafePointError: there is no completed trial.
            SurrogateError: no process could be fitted.
        """
        return self._fits.current(self._fit)

    def _fit(self, start: State | None, cache: DistanceCache) -> Beliefs:
        rows = self.rows_to_fit()
        if len(rows) == 0:
            raise NoSafePointError(f"{self.name} has no completed trial to fit; report data with observe")
        return self.fit(rows, start, cache)

    def fit(self, rows: IntArray, start: State | None, cache: DistanceCache) -> Beliefs:
        """What is believed given the completed trials `rows`.

        Args:
            rows: at least one.
            start: where the last fit ended.
            cache: distances of earlier fits.

        Raises:
            SurrogateError: no process could be fitted.
        """
        return fit_trials(
            self.problem,
            self.trials,
            rows,
            inputs_of=self.inputs_of,
            objective=self.outcomes_to_fit(rows),
            noise=self.noise_prior,
            refine=self.refines(),
            start=start,
            cache=cache,
        )

    def refit(self) -> None:
        """Fit the surrogate anew when it is next needed: what it is fitted to has changed."""
        self._fits.forget()

    @property
    def certified_points(self) -> int | None:
        """Most points of its own discretisation that the method certified in a round; None without one."""
        return None

    @property
    def fit_counts(self) -> FitCounts:
        """Fits that rounds were asked with so far, and how many of them were in numerical trouble."""
        return self._fits.counts

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

    def _best_in_context(self) -> int:
        """Row of the feasible trial that is believed best under the contexts of the last `ask`.

        An outcome under other contexts says little of today's: of the trials believed safe today the one of
        the highest posterior mean counts; where none is, the most probably safe one.
        """
        rows = np.flatnonzero(self.feasible)
        inputs = self.kernel_inputs(self.in_context(self.trials[rows]))
        safe = self.surrogate.believed_safe(inputs, self.confidence)
        if not safe.any():
            return int(rows[np.argmax(self.surrogate.safe_probability(inputs))])
        mean = self.surrogate.objective.predict_mean(inputs)
        return int(rows[np.argmax(np.where(safe, mean, -np.inf))])

    def in_context(self, trials: Trials) -> Trials:
        """The same trials as they would be under the contexts of the last `ask`."""
        return in_context(self.problem, trials, self._context)

    def hold(self, context: FloatArray) -> None:
        """Take the checked contexts of the next trials as known."""
        self._context = context
        if self.problem.contexts:
            self.space.hold(self.problem.contexts, self._context)
        if isinstance(self.problem.candidates, ContextualSet):
            self.problem.candidates.hold(self._context)
