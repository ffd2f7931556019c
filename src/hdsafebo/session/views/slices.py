"""What is believed along each input, through the trial that is believed best."""

from __future__ import annotations

from dataclasses import dataclass

from hdsafebo.session.log.state import LoggedTrial
from hdsafebo.session.session import Session

POINTS = 41
MOST = 8
"""Quantities that are shown, the first ones."""


@dataclass(frozen=True)
class SlicePoint:
    """What is believed at one point of a slice.

    Attributes:
        at: value of the quantity.
        mean, deviation: of the target, without noise.
        safe_probability: that every limit is kept.
    """

    at: float
    mean: float
    deviation: float
    safe_probability: float


@dataclass(frozen=True)
class Slice:
    """A line through a trial along one quantity.

    Attributes:
        name: of the quantity.
        target: objective that is shown.
        centre: the trial's value.
        beliefs: along the range that the hard limits leave.
        trials: value, outcome and whether it was safe, of all trials with an outcome, wherever they lie.
    """

    name: str
    target: str
    centre: float
    beliefs: tuple[SlicePoint, ...]
    trials: tuple[tuple[float, float, bool], ...]


def slices(session: Session, trial: LoggedTrial) -> list[Slice]:
    """Slices of the present target through a trial.

    Args:
        session: an open session.
        trial: one of its trials.

    Returns:
        One per quantity, at most `MOST`; nothing while the model knows nothing.
    """
    space, target = session.space, session.state.target
    lines = dict(list(space.along(trial.point, POINTS).items())[:MOST])
    beliefs = session.believe_all([point for line in lines.values() for _, point in line])
    if not beliefs:
        return []
    done = [t for t in session.state.trials if t.outcomes is not None and t.safety is not None]
    made = []
    for name, line in lines.items():
        own, beliefs = beliefs[: len(line)], beliefs[len(line) :]
        points = tuple(
            SlicePoint(value, b["objective"]["mean"], b["objective"]["sd"], b["safe_probability"])
            for (value, _), b in zip(line, own, strict=True)
        )
        seen = tuple(
            (space.row(t.point)[name], (t.outcomes or {})[target], space.safe(t.safety or {}))
            for t in done
            if points[0].at <= space.row(t.point)[name] <= points[-1].at
        )
        made.append(Slice(name, target, space.row(trial.point)[name], points, seen))
    return made
