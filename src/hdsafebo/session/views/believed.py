"""The best trials according to a model.

Outcomes are noisy and drift from day to day, and the highest of many is the luckiest. The model of `days`
weighs each outcome against those of similar inputs, of repetitions and of the same day.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdsafebo.gp.kernel import exact_distances
from hdsafebo.session.advice.days import day_deviation, fit_days
from hdsafebo.session.advice.informed import MOST_FITTED, kernel_inputs, new_optimizer
from hdsafebo.session.log.state import LoggedTrial
from hdsafebo.session.session import Session
from hdsafebo.threads import one_thread
from hdsafebo.typing import FloatArray, IntArray


@dataclass(frozen=True)
class Believed:
    """A trial, and what is believed of its target.

    Attributes:
        trial: the trial.
        mean, deviation: posterior of the outcome without noise and the effect of a day.
    """

    trial: LoggedTrial
    mean: float
    deviation: float


@one_thread()
def believed_best(
    session: Session, targets: Sequence[str] | None = None, *, initial: bool = False
) -> dict[str, Believed]:
    """For each target the safe trial of the highest posterior mean.

    Inputs of which any trial was unsafe do not count. Of more than `MOST_FITTED` trials only those nearest to
    the highest measured one are fitted, for each target its own.

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
    unsafe = {repr(t.point) for t in trials if t.safety is not None and not space.safe(t.safety)}
    counts = np.array([repr(t.point) not in unsafe for t in known], bool)
    if not counts.any():
        return {}
    search = session.search()
    optimizer = new_optimizer(session.definition, search, session.state.target, session.definition.seed)
    inputs = kernel_inputs(optimizer, search, known)
    days = np.array([t.day for t in known])
    outcomes = np.array([[(t.outcomes or {})[name] for name in names] for t in known])
    modelled = space.scale.modelled(outcomes)
    everything = np.arange(len(known))
    groups = (
        [(list(range(len(names))), everything)]
        if len(known) <= MOST_FITTED
        else [([j], _near_best(inputs, outcomes[:, j], counts)) for j in range(len(names))]
    )
    best = {}
    for columns, rows in groups:
        model = fit_days(inputs[rows], modelled[rows][:, columns], days[rows])
        chosen = np.where(counts[rows, None], model.value, -np.inf).argmax(axis=0)
        for k, (column, row) in enumerate(zip(columns, chosen.tolist(), strict=True)):
            theta, signal = model.theta[k], float(model.signal[k])
            deviation = day_deviation(inputs[rows], days[rows], row, theta, signal)
            mean, deviation = map(float, space.scale.shown(model.value[row, k], np.array(deviation)))
            best[names[column]] = Believed(known[rows[row]], mean, deviation)
    return best


def _near_best(inputs: FloatArray, outcome: FloatArray, counts: NDArray[np.bool_]) -> IntArray:
    """Rows of the trials nearest to the one with the highest outcome that counts, as many as are fitted."""
    centre = int(np.where(counts, outcome, -np.inf).argmax())
    distance = exact_distances(inputs[[centre]], inputs)[0]
    return np.sort(np.argsort(distance, kind="stable")[:MOST_FITTED])
