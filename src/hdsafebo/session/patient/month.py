"""The paper's month on a simulated patient: initial trials, then targets in sequence, a person in the loop.

132 initial trials use typical parameters (bipolar stimulation of neighbouring contacts, the current raised
until it is felt). Then come 504 trials in sequence over the 8 muscles, 441 of them recommended and the others
the therapist's own (paper, clinical experiment); all history is reused for each next muscle. Days end with
a stop and begin with a resume.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from hdsafebo.files.yaml import write_mapping
from hdsafebo.session.definition import StimulationDefinition, parse_definition
from hdsafebo.session.errors import ProtocolError, SessionError
from hdsafebo.session.log.state import LoggedTrial, Point
from hdsafebo.session.measuring.emg import activation
from hdsafebo.session.measuring.recordings import read_recording
from hdsafebo.session.measuring.stimulator import CONTACTS
from hdsafebo.session.patient.patient import RATERS, SCALE, Response, SimulatedPatient
from hdsafebo.session.patient.responses import MUSCLES, Responses
from hdsafebo.session.session import Session
from hdsafebo.session.spaces.space import Report
from hdsafebo.session.spaces.stimulation import CONTACT_COLUMNS, CURRENT_COLUMN
from hdsafebo.session.views.believed import believed_best

INITIAL_TRIALS, FURTHER_TRIALS, RECOMMENDED = 132, 504, 441
TRIALS_PER_DAY = 32
THRESHOLD = 5.0
_COLUMN_LENGTH = 8  # contacts 1-8 lie in one column of the paddle, 9-16 in the other
_RAISE_UNTIL = 7.0  # the therapist raises the current while the lowest score is at least this
_THERAPIST = "therapist"


def example_definition(
    currents_ma: list[float], seed: int, name: str = "simulated patient"
) -> dict[str, Any]:
    """A session file for the simulated patient. Its limits are those of the simulation, not of any device."""
    return {
        "kind": "stimulation",
        "name": name,
        "seed": seed,
        "target": MUSCLES[0],
        "method": {"name": "hdsafebo_shortlist", "settings": {"alpha": 0.999}},
        "emg": {
            "muscles": list(MUSCLES),
            "rate_hz": 2000.0,
            "window_ms": [3.0, 60.0],
            "reference_uv": dict.fromkeys(MUSCLES, 800.0),
            "saturation_uv": 5000.0,
            "flat_uv": 1.0,
        },
        "scores": {"raters": list(RATERS), "minimum": 0.0, "maximum": SCALE, "threshold": THRESHOLD},
        "priors": {
            "poles": [{"cathodes": 1, "anodes": [1, 2, 3]}, {"cathodes": 2, "anodes": [1, 2]}],
            "currents_ma": [c for c in currents_ma if c <= 2.0],
        },
        "stimulator": {
            "pulse_width_us": 210.0,
            "contact_area_mm2": 3.0,
            "current_split": "single_contact",
            "impedance_ohm": [900.0] * CONTACTS,
            "compliance_v": 10.0,
        },
        "limits": {
            "max_current_ma": 2.0,
            "max_step_ma": 0.3,
            "restart_current_ma": 0.15,
            "max_cathodes": 2,
            "max_anodes": 3,
            "max_charge_per_phase_uc": 0.5,
            "max_charge_density_uc_cm2": 15.0,
            "max_shannon_k": 1.0,
            "max_impedance_ohm": 5000.0,
        },
    }


def write_example(folder: Path, responses: Responses, seed: int) -> tuple[Path, Path]:
    """Write `session.yaml` and `initial.csv` for a simulated patient; returns their paths."""
    data = example_definition(responses.currents_ma.tolist(), seed)
    definition = parse_definition(data)
    assert isinstance(definition, StimulationDefinition)
    folder.mkdir(parents=True, exist_ok=True)
    definition_path, initial_path = folder / "session.yaml", folder / "initial.csv"
    write_mapping(definition_path, data, SessionError)
    patient = SimulatedPatient(responses, definition.emg, seed)
    initial_path.write_text(initial_table(patient, definition, seed), encoding="utf-8")
    return definition_path, initial_path


def initial_table(patient: SimulatedPatient, definition: StimulationDefinition, seed: int) -> str:
    """CSV of 132 trials: neighbouring contacts in random order, each raised from the lowest current."""
    rng = np.random.default_rng([seed, 3])
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    mu_columns = [f"mu_{m}" for m in definition.emg.muscles]
    writer.writerow([*CONTACT_COLUMNS, CURRENT_COLUMN, *mu_columns, *(f"score_{r}" for r in RATERS)])
    written = 0
    while written < INITIAL_TRIALS:
        for polarity in rng.permutation(_bipolar_pairs()).tolist():
            for current in definition.priors.currents_ma:
                if written == INITIAL_TRIALS:
                    return stream.getvalue()
                point = {"polarity": polarity, CURRENT_COLUMN: current}
                response = patient.respond(point, 10_000 + written, 0, {})
                writer.writerow(
                    [*polarity, current, *_mu_cells(response, definition), *response.scores.values()]
                )
                written += 1
                if min(response.scores.values()) < _RAISE_UNTIL:
                    break
    return stream.getvalue()


def run_month(
    session: Session,
    patient: SimulatedPatient,
    *,
    trials: int = FURTHER_TRIALS,
    on_trial: Callable[[LoggedTrial], None] = lambda trial: None,
) -> None:
    """Carry a session on to `trials` further trials; goes on where an interrupted one ended.

    Args:
        session: made from `write_example`.
        patient: the same that made the initial trials.
        trials: over all targets; one in eight is the therapist's.
        on_trial: called after each record.
    """
    per_target = max(1, trials // len(session.space.targets))
    for number in _remaining(session, trials):
        target = session.space.targets[min(number // per_target, len(session.space.targets) - 1)]
        if session.state.running is None:
            _keep_days(session, number)
            if target != session.state.target:
                session.switch_target(_THERAPIST, target)
            _start_trial(session, number)
        trial, response = answer(session, patient)
        recording = None if response.recording is None else (response.recording, f"trial{trial}.csv")
        on_trial(session.record(_THERAPIST, Report(recording, response.scores)))


def simulated_patient(session: Session, responses: Responses, seed: int) -> SimulatedPatient:
    """The simulated patient of a session that was made from `write_example`."""
    if not isinstance(session.definition, StimulationDefinition):
        raise SessionError(
            f"a simulated patient needs a session of kind stimulation, not {session.definition.kind}"
        )
    return SimulatedPatient(responses, session.definition.emg, seed)


def answer(session: Session, patient: SimulatedPatient) -> tuple[int, Response]:
    """Number of the running trial and the patient's response to it.

    Raises:
        ProtocolError: no trial is running.
    """
    running = session.state.running
    if running is None:
        raise ProtocolError("no trial is running: approve a suggestion or start a manual trial first")
    number = sum(t.origin != "initial" for t in session.state.trials) - 1
    labels = {"session": session.state.session, "trial": str(running.number)}
    return running.number, patient.respond(running.point, running.number, day_of(number), labels)


def day_of(number: int) -> int:
    """Day of the protocol on which a further trial (from 0) takes place, from 1."""
    return 1 + number // TRIALS_PER_DAY


def _remaining(session: Session, trials: int) -> Iterator[int]:
    """Numbers (from 0) of the further trials that have no record yet."""
    later = [t for t in session.state.trials if t.origin != "initial"]
    done = sum(t.status != "running" for t in later)
    yield from range(done, trials)


def _keep_days(session: Session, number: int) -> None:
    """A stop and a resume where a new day begins."""
    begun = sum(e.kind == "resumed" for e in session.entries) + 1
    if day_of(number) > begun:
        session.stop(_THERAPIST, f"end of day {begun}")
    if session.stopped is not None:
        session.resume(_THERAPIST)


def _start_trial(session: Session, number: int) -> None:
    """One in eight trials is the therapist's; so is one where the optimiser abstains."""
    if number % 8 != 7:
        try:
            suggestion = session.suggest(_THERAPIST)
            session.approve(_THERAPIST, suggestion.number)
            return
        except ProtocolError as error:
            if "no suggestion" not in str(error):
                raise
    session.manual(_THERAPIST, _therapist_point(session), "my own trial")


def _therapist_point(session: Session) -> Point:
    """What is believed best so far for the target, at the highest permitted current not above its own."""
    believed = believed_best(session, [session.state.target])
    if not believed:
        raise SessionError("no safe trial is known; a therapist would not start")
    best = believed[session.state.target].trial
    definition = session.definition
    assert isinstance(definition, StimulationDefinition)
    for current in reversed(definition.priors.currents_ma):
        point = {"polarity": best.point["polarity"], CURRENT_COLUMN: current}
        if current <= best.point[CURRENT_COLUMN] and not session.space.breaches(
            point, session.state.last_point
        ):
            return point
    raise SessionError("the best configuration is not permitted at any current")


def _bipolar_pairs() -> list[list[int]]:
    """Neighbouring contacts of a column as cathode and anode, both ways round."""
    pairs = []
    for first in [i for i in range(CONTACTS - 1) if (i + 1) % _COLUMN_LENGTH]:
        for cathode, anode in ((first, first + 1), (first + 1, first)):
            row = [0] * CONTACTS
            row[cathode], row[anode] = -1, 1
            pairs.append(row)
    return pairs


def _mu_cells(response: Response, definition: StimulationDefinition) -> list[str]:
    if response.recording is None:
        return [""] * len(definition.emg.muscles)
    emg = definition.emg
    mu = activation(read_recording(response.recording, "initial.csv", emg), emg)
    return [f"{value:.6g}" for value in mu]
