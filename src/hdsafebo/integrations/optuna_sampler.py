"""An Optuna sampler: `optuna.create_study(sampler=HdSafeBOSampler(alpha=0.95), storage=...)`.

The objective function reports each limit with Optuna's `trial.set_constraint(name, value)`, kept when at most
0. Trials that are known to be safe come first: `study.enqueue_trial({...})`. What other processes add to the
storage is taken in before each suggestion; the sampler itself stores nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)
from optuna.samplers import BaseSampler
from optuna.search_space import IntersectionSearchSpace
from optuna.study import Study as OptunaStudy
from optuna.study import StudyDirection
from optuna.trial import FrozenTrial, TrialState

from hdsafebo.errors import NoSafePointError
from hdsafebo.system.description import System
from hdsafebo.system.errors import DescriptionError
from hdsafebo.system.outcomes import Limit, Objective
from hdsafebo.system.parameters import Choice, Integer, Parameter, Real
from hdsafebo.system.study import Study

_OBJECTIVE = "objective value"


class HdSafeBOSampler(BaseSampler):
    """See the module.

    Args:
        method: name of the optimiser.
        seed: of its random generator.
        settings: of the method, such as `alpha`.
    """

    def __init__(self, *, method: str = "hdsafebo_local", seed: int = 0, **settings: Any) -> None:
        self._make = {"method": method, "seed": seed, **settings}
        self._space = IntersectionSearchSpace()
        self._study: Study | None = None
        self._known: dict[int, int | None] = {}  # number of an Optuna trial -> id here, None once it is told

    def before_trial(self, study: OptunaStudy, trial: FrozenTrial) -> None:
        """Refuse what cannot be searched, before anything is drawn.

        Raises:
            DescriptionError: the study has several objectives.
        """
        if len(study.directions) != 1:
            raise DescriptionError(f"the study has {len(study.directions)} objectives; expected one")

    def infer_relative_search_space(
        self, study: OptunaStudy, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        """The parameters of all trials so far; none for a trial that was enqueued with its values."""
        if "fixed_params" in trial.system_attrs:
            return {}
        return {n: d for n, d in self._space.calculate(study).items() if not d.single()}

    def sample_relative(
        self, study: OptunaStudy, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """A suggestion that is believed safe.

        Raises:
            NoSafePointError: nothing is known or believed to be safe.
            DescriptionError: a distribution has no counterpart here, or a trial lacks a limit.
        """
        if not search_space:
            return {}
        trials = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.FAIL))
        trials = [t for t in trials if set(search_space) <= set(t.params)]
        ours = self._follow(study, search_space, trials)
        suggestion = ours.ask()
        self._known[trial.number] = suggestion.trial
        return dict(suggestion.setting)

    def sample_independent(
        self, study: OptunaStudy, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """Only what has a single value; anything else would be drawn without regard to safety."""
        if param_distribution.single():
            if isinstance(param_distribution, CategoricalDistribution):
                return param_distribution.choices[0]
            return cast(FloatDistribution | IntDistribution, param_distribution).low
        raise NoSafePointError(
            f"parameter {param_name!r} was not part of all earlier trials, so nothing is known to be safe; "
            "enqueue safe trials first: study.enqueue_trial({name: value, ...}), with a value for every "
            "parameter"
        )

    def _follow(
        self, study: OptunaStudy, space: Mapping[str, BaseDistribution], trials: list[FrozenTrial]
    ) -> Study:
        """The study here, with all results of the Optuna trials."""
        names = sorted({name for t in trials for name in t.constraints})
        if not names:
            raise NoSafePointError(
                "no trial has reported a limit; call trial.set_constraint(name, value) in the objective "
                "function, with a value of at most 0 when the limit is kept"
            )
        system = System(
            study.study_name[:64],
            tuple(_parameter(name, d) for name, d in space.items()),
            Objective(_OBJECTIVE, "minimise" if study.direction == StudyDirection.MINIMIZE else "maximise"),
            tuple(Limit(name, at_most=0.0) for name in names),
        )
        if self._study is None or self._study.system != system:
            self._study, self._known = Study(system, **self._make), {}
        for t in trials:
            asked = self._known.get(t.number, -1)
            if asked is None:
                continue
            failed = t.state == TrialState.FAIL
            results = None if failed else self._results(t, names)
            setting = {name: t.params[name] for name in space}
            if asked >= 0:
                self._study.tell(asked, results, failed=failed, ran=setting)
            elif failed:
                self._study.observe([setting | {"status": "failed"}])
            else:
                assert results is not None
                self._study.observe([setting | results])
            self._known[t.number] = None
        return self._study

    @staticmethod
    def _results(trial: FrozenTrial, names: list[str]) -> dict[str, float]:
        missing = [name for name in names if name not in trial.constraints]
        if missing:
            raise DescriptionError(
                f"trial {trial.number} has not reported {', '.join(missing)}; every trial reports every "
                "limit with trial.set_constraint"
            )
        assert trial.value is not None
        return {_OBJECTIVE: trial.value} | {name: trial.constraints[name] for name in names}


def _parameter(name: str, distribution: BaseDistribution) -> Parameter:
    if isinstance(distribution, FloatDistribution):
        return Real(name, distribution.low, distribution.high, log=distribution.log, step=distribution.step)
    if isinstance(distribution, IntDistribution):
        step = distribution.step if distribution.step != 1 else None
        return Integer(name, distribution.low, distribution.high, log=distribution.log, step=step)
    if isinstance(distribution, CategoricalDistribution):
        return Choice(name, cast(tuple[str | int | float, ...], tuple(distribution.choices)))
    raise DescriptionError(f"parameter {name!r} has a {type(distribution).__name__}, which is unknown here")
