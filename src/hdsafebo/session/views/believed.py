"""The best trials according to a model.

Outcomes are noisy and drift from day to day, and the highest of many is the luckiest. The model of `days`
weighs each outcome against those of similar inputs, of repetitions and of the same day.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdsafebo.session.advice.days import day_deviation, fit_days
from hdsafebo.session.advice.informed import kernel_inputs, new_optimiser
from hdsafebo.session.log.state import Trial
from hdsafebo.session.session import Session


@dataclass(frozen=True)
class Believed:
    """A trial, and what is believed of its target.

    Attributes:
        trial: the trial.
        mean, deviation: posterior of the outcome without noise and the effect of a day.
    """

    trial: Trial
    mean: float
    deviation: float


def believed_best(
    session: Session, targets: Sequence[str] | None = None, *, initial: bool = False
) -> dict[str, Believed]:
    """For each target the safe trial of the highest posterior mean.

    Inputs of which any trial was unsafe do not count.

    Args:
        session: an open session.
        targets: some of the session's; None means all.
        initial: only the initial trials are known.

    Returns:
        Nothing for any target when no safe trial has outcomes.
    """
    space = session.space
    names = space.targets if targets is None else tuple(targets)
    trials = [t for t in session.state.trials if t.origin == "initial" or not initial]
    known = [t for t in trials if t.outcomes is not None and t.safety is not None]
    unsafe = [t.point for t in trials if t.safety is not None and not space.safe(t.safety)]
    counts = np.array([t.point not in unsafe for t in known])
    if not counts.any():
        return {}
    search = session.search()
    optimiser = new_optimiser(session.definition, search, session.state.target, session.definition.seed)
    inputs = kernel_inputs(optimiser, search, known)
    days = np.array([t.day for t in known])
    outcomes = np.array([[(t.outcomes or {})[name] for name in names] for t in known])
    model = fit_days(inputs, space.scale.modelled(outcomes), days)
    rows = np.where(counts[:, None], model.value, -np.inf).argmax(axis=0)
    best = {}
    for j, (name, row) in enumerate(zip(names, rows.tolist(), strict=True)):
        deviation = day_deviation(inputs, days, row, model.theta[j], float(model.signal[j]))
        mean, deviation = map(float, space.scale.shown(model.value[row, j], np.array(deviation)))
        best[name] = Believed(known[row], mean, deviation)
    return best
