"""An optimiser that is told what a session knows, for any of its targets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdsafebo.errors import ParamsError
from hdsafebo.optimizers.base import Optimizer
from hdsafebo.optimizers.settings import SafeSetSettings
from hdsafebo.problem import encoded
from hdsafebo.session.advice.methods import make_method, session_method
from hdsafebo.session.advice.search import Search
from hdsafebo.session.definition import Definition
from hdsafebo.session.log.state import LoggedTrial
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import FloatArray

MOST_FITTED = 1000  # trials that a model is fitted to: with all of 10,000 a suggestion would take minutes
_DEFAULTS = {"empty_safe_set": "abstain", "max_fitted_trials": MOST_FITTED}


def informed_optimizer(
    definition: Definition,
    search: Search,
    target: str,
    seed: int,
    trials: Sequence[LoggedTrial],
    before: Optimizer | None = None,
    today: int = 0,
) -> Optimizer:
    """A new optimiser of a target that has observed all delivered trials with a record.

    Args:
        definition: of the session.
        search: of the session.
        target: objective.
        seed: of the optimiser.
        trials: all trials of the session, in order.
        before: that of the target before; the codes it searched stay with their trials (see `realise`).
        today: number of the present day.

    Raises:
        ParamsError: the method has no safe set.
    """
    optimizer = new_optimizer(definition, search, target, seed)
    known = [t for t in trials if t.status != "running" and t.delivered]
    if known:
        inputs = [search.input_of(t.point) for t in known]
        results = [results_of(t, target, search, trials) for t in known]
        x = np.vstack([x for x, _ in inputs])
        optimizer.observe(
            x,
            [objective for objective, _, _ in results],
            np.array([safety for _, safety, _ in results]).reshape(-1, len(search.space.safety)),
            status=[status for _, _, status in results],
            candidate=[row for _, row in inputs],
            codes=None if before is None else _codes_of(x, before.trials),
            initial=True,
        )
    optimizer.begin_day(today, np.array([t.day for t in known], np.int64))
    return optimizer


def _codes_of(x: FloatArray, trials: Trials) -> FloatArray:
    """(n, d) codes of the (n, D) inputs among `trials`; NaN for inputs that are not."""
    known = {row.tobytes(): z for row, z in zip(trials.x, trials.z, strict=True)}
    nothing = np.full(trials.z.shape[1], np.nan)
    return np.stack([known.get(row.tobytes(), nothing) for row in x])


def new_optimizer(definition: Definition, search: Search, target: str, seed: int) -> Optimizer:
    """An optimiser that knows nothing yet; see `informed_optimizer`."""
    kind, _ = session_method(definition.method.name)
    if not issubclass(kind.Settings, SafeSetSettings):
        raise ParamsError(f"method.name: {definition.method.name!r} has no safe set; expected one that has")
    return make_method(
        definition.method.name,
        search.problem(target),
        embedding=search.embedding,
        bounds=search.code_bounds,
        seed=seed,
        **(_DEFAULTS | dict(definition.method.settings)),
    )


def kernel_inputs(optimizer: Optimizer, search: Search, trials: Sequence[LoggedTrial]) -> FloatArray:
    """(n, p) what the optimiser measures distances between, for the points of trials."""
    inputs = [search.input_of(t.point) for t in trials]
    x = np.vstack([x for x, _ in inputs])
    z = x if optimizer.embedding is None else encoded(optimizer.embedding, x)
    rows = np.array([row for _, row in inputs])
    return optimizer.kernel_inputs(Trials.pending(x, z, len(search.space.safety), candidate=rows))


def results_of(
    trial: LoggedTrial, target: str, search: Search, trials: Sequence[LoggedTrial]
) -> tuple[float, list[float], Status]:
    """Objective, safety values and status of a trial, as an optimiser is told them.

    A trial that was unsafe and gave no objective (no recording) must still teach that it was unsafe. It is
    told with the lowest objective seen so far, in the model only: the log keeps that there is none.
    """
    space = search.space
    nothing = float("nan"), [float("nan")] * len(space.safety), Status.FAILED
    if trial.safety is None:
        return nothing
    safety = space.judged(trial.safety)
    if trial.outcomes is not None:
        return trial.outcomes[target], safety, Status.COMPLETED
    seen = [t.outcomes[target] for t in trials[: trial.number] if t.outcomes is not None]
    if space.safe(trial.safety) or not seen:
        return nothing
    return min(seen), safety, Status.COMPLETED
