"""The best trials according to a model.

Outcomes are noisy and drift from day to day, and the highest of many is the luckiest. The model of `days`
weighs each outcome against those of similar inputs, of repetitions and of the same day.
"""

from __future__ import annotations

import numpy as np

from hdsafebo.session.days import fit_days
from hdsafebo.session.informed import kernel_inputs, new_optimiser
from hdsafebo.session.session import Session
from hdsafebo.session.state import Trial


def believed_best(session: Session, *, initial: bool = False) -> dict[str, tuple[Trial, float]]:
    """For each target the safe trial that is believed best, and what is believed of it.

    Inputs of which any trial was unsafe do not count.

    Args:
        session: an open session.
        initial: only the initial trials are known.

    Returns:
        Nothing for any target when no safe trial has outcomes.
    """
    space = session.space
    trials = [t for t in session.state.trials if t.origin == "initial" or not initial]
    known = [t for t in trials if t.outcomes is not None and t.safety is not None]
    unsafe = [t.point for t in trials if t.safety is not None and not space.safe(t.safety)]
    counts = np.array([t.point not in unsafe for t in known])
    if not counts.any():
        return {}
    search = session.search()
    optimiser = new_optimiser(session.definition, search, session.state.target, session.definition.seed)
    model = fit_days(
        kernel_inputs(optimiser, search, known),
        np.array([[(t.outcomes or {})[target] for target in space.targets] for t in known]),
        np.array([t.day for t in known]),
    )
    rows = np.where(counts[:, None], model.value, -np.inf).argmax(axis=0)
    return {
        target: (known[row], float(model.value[row, j]))
        for j, (target, row) in enumerate(zip(space.targets, rows.tolist(), strict=True))
    }
