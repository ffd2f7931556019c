"""What a simulated month came to, against the truth that only a simulation knows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdsafebo.session.candidates.stimulation_set import enumerate_polarities
from hdsafebo.session.definition import StimulationDefinition
from hdsafebo.session.log.state import Point
from hdsafebo.session.measuring.emg import selectivity
from hdsafebo.session.patient.month import THRESHOLD
from hdsafebo.session.patient.patient import SimulatedPatient
from hdsafebo.session.session import Session
from hdsafebo.session.views.believed import believed_best


@dataclass(frozen=True)
class MonthResult:
    """What a month came to. Selectivities are by muscle, and true ones where nothing else is said.

    Attributes:
        recommended: trials that the optimiser recommended.
        unsafe: how many of them were rated unsafe.
        breaches: trials outside the hard limits (none, if the software is right).
        initial_best, final_best: of the initial trial, and of the trial of the whole month, that the model
            believes best of those that were safe, each time with the data of that time.
        initial_highest, final_highest: of those with the highest single measurement.
        initial_measured, final_measured: these measurements themselves (what the paper compares).
        reachable: highest of all stimulations within the priors whose comfort without noise is safe.
    """

    recommended: int
    unsafe: int
    breaches: int
    initial_best: dict[str, float]
    final_best: dict[str, float]
    initial_highest: dict[str, float]
    final_highest: dict[str, float]
    initial_measured: dict[str, float]
    final_measured: dict[str, float]
    reachable: dict[str, float]

    @property
    def improved(self) -> int:
        """Number of muscles whose best improved."""
        return _higher(self.final_best, self.initial_best)

    @property
    def improved_highest(self) -> int:
        """The same for the trials with the highest measurement."""
        return _higher(self.final_highest, self.initial_highest)

    @property
    def improved_on_highest(self) -> int:
        """The same for the trial believed best in the end over the initial one measured highest."""
        return _higher(self.final_best, self.initial_highest)

    @property
    def improved_measured(self) -> int:
        """Number of muscles whose highest measurement rose."""
        return _higher(self.final_measured, self.initial_measured)


def _higher(final: dict[str, float], initial: dict[str, float]) -> int:
    """Number of muscles with a higher value in the end."""
    return sum(value > initial[muscle] for muscle, value in final.items())


def evaluate_month(session: Session, patient: SimulatedPatient) -> MonthResult:
    """Count and compare."""
    space = session.space
    done = [t for t in session.state.trials if t.origin != "initial" and t.delivered and t.safety is not None]
    recommended = [t for t in done if t.origin == "suggested"]
    best: dict[bool, dict[str, float]] = {True: {}, False: {}}
    highest: dict[bool, dict[str, float]] = {True: {}, False: {}}
    measurements: dict[bool, dict[str, float]] = {True: {}, False: {}}
    for initial in (True, False):
        believed = believed_best(session, initial=initial)
        for i, muscle in enumerate(space.targets):
            measured = session.best(muscle, origin="initial" if initial else "")
            for store, trial in ((best, believed[muscle].trial), (highest, measured)):
                true = 0.0 if trial is None else float(selectivity(patient.activation(trial.point))[i])
                store[initial][muscle] = true
            outcomes = None if measured is None else measured.outcomes
            measurements[initial][muscle] = 0.0 if outcomes is None else outcomes[muscle]
    return MonthResult(
        len(recommended),
        sum(not space.safe(t.safety or {}) for t in recommended),
        count_breaches(session),
        best[True],
        best[False],
        highest[True],
        highest[False],
        measurements[True],
        measurements[False],
        reachable_selectivity(session, patient),
    )


def reachable_selectivity(session: Session, patient: SimulatedPatient) -> dict[str, float]:
    """Highest true selectivity of every muscle within the priors, where the true comfort is safe."""
    definition = session.definition
    assert isinstance(definition, StimulationDefinition)
    polarity = enumerate_polarities(definition.priors)
    mu, comfort = patient.truth(polarity, np.array(definition.priors.currents_ma))
    values = selectivity(mu)
    return {
        muscle: float(values[comfort >= THRESHOLD, i].max()) for i, muscle in enumerate(session.space.targets)
    }


def count_breaches(session: Session) -> int:
    """Trials of the log that were outside the hard limits when they began."""
    last: Point | None = None
    breaches = 0
    numbers = iter(
        range(sum(t.origin == "initial" for t in session.state.trials) + 1, len(session.state.trials) + 1)
    )
    for entry in session.entries:
        if entry.kind in ("approved", "modified", "manual"):
            breaches += bool(session.space.breaches(session.state.trials[next(numbers) - 1].point, last))
        elif entry.kind == "recorded" and entry.payload["delivered"]:
            last = session.state.trials[entry.payload["trial"] - 1].point
        elif entry.kind == "stopped":
            last = None
    return breaches
