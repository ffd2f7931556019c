"""What is believed, in the user's units: predictions, the best settings, what another trial may gain.

Models are imported where they are used, so that describing a system does not wait for them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hdsafebo.system.description import DEVIATION, SAFE
from hdsafebo.system.problem import SettingsList, SystemProblem
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray, IntArray

if TYPE_CHECKING:
    import pandas as pd

    from hdsafebo.optimizers.base import Optimizer

SAFE_PROBABILITY = "safe_probability"
_SQRT_2PI = np.sqrt(2.0 * np.pi)
_SPREAD = 2048
"""Points over the whole box where a gain is sought."""
_NEAR = (512, 0.1)
"""Number and standard deviation, in the box, of points around the best trial where a gain is sought."""


@dataclass(frozen=True)
class Belief:
    """A setting, what was measured of it and what is believed of it.

    Attributes:
        trial: id of its trial.
        setting: values of parameters and contexts.
        objective: as measured.
        outcomes: all that was measured.
        mean: of the objective, without noise, as believed.
        sd: standard deviation of that belief.
        safe_probability: that every limit is kept, as believed.
    """

    trial: int
    setting: dict[str, Any]
    objective: float
    outcomes: dict[str, float]
    mean: float
    sd: float
    safe_probability: float


@dataclass(frozen=True)
class Best:
    """The best settings that were tried and kept every limit.

    Attributes:
        measured: of the best measurement; of many noisy ones the highest is the luckiest.
        believed: of the best belief, under the context that was asked for.
    """

    measured: Belief
    believed: Belief

    @property
    def objective(self) -> float:
        """The best measurement."""
        return self.measured.objective


def pending(optimizer: Optimizer, x: FloatArray) -> Trials:
    """Trials at (n, D) points of the box, to be looked at only."""
    problem = optimizer.problem
    candidates = problem.candidates
    rows = candidates.rows_of(x) if isinstance(candidates, SettingsList) else np.full(len(x), -1)
    return Trials.pending(x, x.copy(), len(problem.safety), candidate=rows)


def predict(optimizer: Optimizer, x: FloatArray) -> pd.DataFrame:
    """Mean, standard deviation and safe probability of every function at (n, D) points of the box.

    Columns: `<outcome>` (mean), `<outcome>_sd`, `<limit>_safe`, `completes_safe` once trials have failed and
    failures teach, and `safe_probability` of all together.

    Raises:
        NoSafePointError: nothing was told yet.
    """
    import pandas as pd

    problem = optimizer.problem
    assert isinstance(problem, SystemProblem)
    system, surrogate = problem.codec.system, optimizer.surrogate
    inputs = optimizer.kernel_inputs(pending(optimizer, x))
    mean, sd = surrogate.objective.predict(inputs)
    columns = {
        system.objective.name: system.objective.sign * mean,
        system.objective.name + DEVIATION: sd,
    }
    means, sds = surrogate.predict_safety(inputs)
    safe = surrogate.safe_probabilities(inputs)
    j = 0
    for limit in system.limits:
        sides = slice(j, j + len(limit.sides))
        columns[limit.name] = limit.sides[0][0] * means[:, j]
        columns[limit.name + DEVIATION] = sds[:, j]
        columns[limit.name + SAFE] = safe[:, sides].prod(axis=1)
        j = sides.stop
    if means.shape[1] > j:
        columns["completes" + SAFE] = safe[:, j:].prod(axis=1)
    columns[SAFE_PROBABILITY] = safe.prod(axis=1)
    return pd.DataFrame(columns)


def best(optimizer: Optimizer, context: FloatArray | None) -> Best | None:
    """The best trials that kept every limit; None when there is none.

    Args:
        optimizer: of the study.
        context: (c,) columns under which beliefs are compared; None takes each trial under its own.
    """
    seen = _Seen.of(optimizer, np.flatnonzero(optimizer.feasible), context)
    if seen is None:
        return None
    likely = optimizer.surrogate.believed_safe(seen.inputs, optimizer.confidence)
    counts = likely if likely.any() else seen.safe >= seen.safe.max()
    lucky = int(np.argmax(seen.trials.objective))
    return Best(seen.belief(lucky), seen.belief(int(np.argmax(np.where(counts, seen.mean, -np.inf)))))


def safest(optimizer: Optimizer, context: FloatArray | None) -> Belief | None:
    """The trial that kept every limit and is most probably safe; None when there is none.

    Args:
        optimizer: of the study.
        context: (c,) columns under which trials would be run again; None takes each trial under its own.
    """
    seen = _Seen.of(optimizer, np.flatnonzero(optimizer.feasible), context)
    return None if seen is None else seen.belief(int(np.argmax(seen.safe)))


@dataclass(frozen=True)
class _Seen:
    """Trials and what is believed of them: k of them, all completed.

    Attributes:
        problem: of the trials.
        trials: as they were run.
        x: (k, D) their inputs, under the context that was asked for.
        inputs: (k, p) kernel inputs of these.
        mean, sd: (k,) of the objective, where larger is better.
        safe: (k,) safe probabilities.
    """

    problem: SystemProblem
    trials: Trials
    x: FloatArray
    inputs: FloatArray
    mean: FloatArray
    sd: FloatArray
    safe: FloatArray

    @classmethod
    def of(cls, optimizer: Optimizer, rows: IntArray, context: FloatArray | None) -> _Seen | None:
        from hdsafebo.optimizers.core.contexts import in_context

        if len(rows) == 0:
            return None
        problem = optimizer.problem
        assert isinstance(problem, SystemProblem)
        trials = optimizer.trials[rows]
        x = trials.x if context is None else in_context(problem, trials, context).x
        inputs = optimizer.kernel_inputs(pending(optimizer, x))
        mean, sd = optimizer.surrogate.objective.predict(inputs)
        return cls(problem, trials, x, inputs, mean, sd, optimizer.surrogate.safe_probability(inputs))

    def belief(self, i: int) -> Belief:
        sign = self.problem.codec.system.objective.sign
        return Belief(
            trial=int(self.trials.id[i]),
            setting=self.problem.codec.records(self.x[[i]])[0],
            objective=sign * float(self.trials.objective[i]),
            outcomes=outcomes(self.problem, self.trials)[i],
            mean=sign * float(self.mean[i]),
            sd=float(self.sd[i]),
            safe_probability=float(self.safe[i]),
        )


def what_is_safest(optimizer: Optimizer, context: FloatArray | None) -> str:
    """What to do where nothing new is believed safe: the end of a message, empty without a safe trial."""
    known = safest(optimizer, context)
    if known is None:
        return ""
    return (
        f". Of what was tried, trial {known.trial} is the safest (safe with {known.safe_probability:.3f}): "
        f"{known.setting}; run it or careful settings near it again, and pass the results to observe"
    )


def with_probabilities(optimizer: Optimizer, trials: Trials) -> Trials:
    """Asked trials of a method without a model, with what the common model believes of them."""
    if optimizer.consults_model or not optimizer.trials.completed.any():
        return trials
    inputs = optimizer.kernel_inputs(pending(optimizer, trials.x))
    return replace(trials, predicted_safe_probability=optimizer.surrogate.safe_probability(inputs))


def outcomes(problem: SystemProblem, trials: Trials) -> list[dict[str, float]]:
    """What was measured, by name, in the user's signs."""
    system = problem.codec.system
    table = {system.objective.name: system.objective.sign * trials.objective}
    j = 0
    for limit in system.limits:
        table[limit.name] = limit.sides[0][0] * trials.safety[:, j]
        j += len(limit.sides)
    return [{name: float(values[i]) for name, values in table.items()} for i in range(len(trials))]


def expected_gain(optimizer: Optimizer, context: FloatArray | None) -> float:
    """The largest expected improvement over the believed best, of what is believed safe; in its units.

    Expected improvement counts what is better and takes the rest for nothing (Jones, Schonlau and Welch,
    1998). It is sought at points spread over the whole box and near the believed best; the same ones at
    every call.

    Args:
        optimizer: of the study.
        context: (c,) columns of the contexts.

    Returns:
        0 when nothing untried is believed safe.
    """
    from scipy.special import ndtr

    from hdsafebo.search.candidates import sobol_points

    problem, surrogate = optimizer.problem, optimizer.surrogate
    assert isinstance(problem, SystemProblem)
    rng = np.random.default_rng(0)
    found = best(optimizer, context)
    if problem.candidates is not None:
        x = problem.candidates.inputs(_untried(optimizer, context))
    else:
        x = sobol_points(_SPREAD, problem.codec.dimension, rng)
        if found is not None:
            centre = optimizer.trials.x[found.believed.trial]
            near = centre + _NEAR[1] * rng.standard_normal((_NEAR[0], len(centre)))
            x = np.concatenate([x, np.clip(near, 0.0, 1.0)])
    if context is not None:
        x[:, list(problem.contexts)] = context
    x = problem.land(x) if problem.lands else x
    inputs = optimizer.kernel_inputs(pending(optimizer, x))
    safe = surrogate.believed_safe(inputs, optimizer.confidence)
    if not safe.any():  # or no row is left
        return 0.0
    mean, sd = surrogate.objective.predict(inputs[safe])
    if found is None:
        return float("inf")
    sign = problem.codec.system.objective.sign
    u = (mean - sign * found.believed.mean) / sd
    return float((sd * (u * ndtr(u) + np.exp(-0.5 * u * u) / _SQRT_2PI)).max())


def _untried(optimizer: Optimizer, context: FloatArray | None) -> IntArray:
    """Rows of a list that `ask` may still suggest; under another context a row is another input."""
    problem, trials = optimizer.problem, optimizer.trials
    assert problem.candidates is not None
    here = np.empty(0) if context is None else context
    same = (trials.x[:, list(problem.contexts)] == here).all(axis=1)
    return np.setdiff1d(np.arange(len(problem.candidates)), trials.candidate[same])
