"""Numbers about a session that the command line, the page and the report share."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from hdsafebo.gp.safe_set import alpha_of
from hdsafebo.optimizers.settings import SafeSetSettings
from hdsafebo.session.log.state import LoggedSuggestion, LoggedTrial
from hdsafebo.session.session import Session

CALIBRATION_EDGES = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 0.999, 1.0)


@dataclass(frozen=True)
class CalibrationBin:
    """Trials whose predicted safe probability lies in one interval.

    Attributes:
        low, high: the interval.
        trials: number of trials.
        predicted: mean predicted safe probability.
        observed: share that was safe.
        interval: 95% Clopper-Pearson interval of the observed share.
    """

    low: float
    high: float
    trials: int
    predicted: float
    observed: float
    interval: tuple[float, float]


def status(session: Session) -> dict[str, Any]:
    """Where the session stands, as plain data."""
    state, space = session.state, session.space
    best = session.best()
    return {
        "disclaimer": session.disclaimer,
        "name": session.definition.name,
        "session": state.session,
        "kind": session.definition.kind,
        "target": state.target,
        "targets": list(space.targets),
        "stopped": session.stopped,
        "head": {"seq": state.head.seq, "hash": state.head.hash, "time": state.head.time}
        if state.head
        else None,
        "suggestion": None
        if state.open_suggestion is None
        else suggestion_data(session, state.open_suggestion),
        "running": [trial_data(session, t) for t in state.running_trials],
        "at_once": state.at_once,
        "best": None if best is None else trial_data(session, best),
        "initial_best": _initial_best(session),
        "last": None if state.last_point is None else space.describe(state.last_point),
        "counts": counts(session),
        "promised": promised(session),
        "notices": list(session.store.notices),
    }


def counts(session: Session) -> dict[str, int]:
    """How many trials of which kind there are, and how many were unsafe."""
    trials = session.state.trials
    made = [t for t in trials if t.origin != "initial" and t.status != "running" and t.delivered]
    return {
        "initial": sum(t.origin == "initial" for t in trials),
        "recommended": sum(t.origin == "suggested" for t in made),
        "modified": sum(t.origin == "modified" for t in made),
        "manual": sum(t.origin == "manual" for t in made),
        "refused": sum(s.decision == "refused" for s in session.state.suggestions),
        "unsafe_recommended": sum(t.origin == "suggested" and is_unsafe(session, t) for t in made),
        "unsafe_other": sum(t.origin != "suggested" and is_unsafe(session, t) for t in made),
    }


def promised(session: Session) -> dict[str, float]:
    """The confidence of the method: beta, and the safe probability alpha that it promises per suggestion."""
    from hdsafebo.session.advice.methods import session_method

    kind, fixed = session_method(session.definition.method.name)
    settings = kind.Settings.model_validate({**fixed, **session.definition.method.settings})
    assert isinstance(settings, SafeSetSettings), "a session's method has a safe set"
    beta = settings.confidence
    return {"beta": beta, "alpha": alpha_of(beta)}


def is_unsafe(session: Session, trial: LoggedTrial) -> bool:
    """Whether a trial's safety values are known and miss a threshold."""
    return trial.safety is not None and not session.space.safe(trial.safety)


def suggestion_data(session: Session, suggestion: LoggedSuggestion) -> dict[str, Any]:
    """A suggestion as plain data."""
    return {
        "number": suggestion.number,
        "point": suggestion.point,
        "text": session.space.describe(suggestion.point),
        "target": suggestion.target,
        "belief": suggestion.belief,
        "decision": suggestion.decision,
    }


def trial_data(session: Session, trial: LoggedTrial) -> dict[str, Any]:
    """A trial as plain data."""
    return {
        "number": trial.number,
        "origin": trial.origin,
        "point": trial.point,
        "text": session.space.describe(trial.point),
        "target": trial.target,
        "status": trial.status,
        "outcomes": trial.outcomes,
        "safety": trial.safety,
        "unsafe": is_unsafe(session, trial),
        "scores": trial.details.get("scores"),
        "belief": trial.belief,
        "decided_by": trial.decided_by,
        "reason": trial.reason,
        "failure": trial.failure,
        "recorded": trial.recorded,
    }


def calibration(session: Session) -> list[CalibrationBin]:
    """Predicted safe probability of recommended trials against how often they were safe."""
    from scipy.stats import binomtest

    pairs = [
        (t.belief["safe_probability"], session.space.safe(t.safety))
        for t in session.state.trials
        if t.origin == "suggested" and t.belief is not None and t.safety is not None
    ]
    bins = []
    for low, high in pairwise(CALIBRATION_EDGES):
        inside = [(p, ok) for p, ok in pairs if low <= p < high or (high == 1.0 and p == 1.0)]
        if not inside:
            continue
        n, safe = len(inside), sum(ok for _, ok in inside)
        limits = binomtest(safe, n).proportion_ci(0.95, "exact")
        interval = float(limits.low), float(limits.high)
        predicted = float(np.mean([p for p, _ in inside]))
        bins.append(CalibrationBin(low, high, n, predicted, safe / n, interval))
    return bins


def _initial_best(session: Session) -> float | None:
    best = session.best(origin="initial")
    return None if best is None or best.outcomes is None else best.outcomes[session.state.target]
