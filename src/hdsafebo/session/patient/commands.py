"""`hdsafebo session patient ...`: a simulated patient, for trying a session out."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from hdsafebo.session.words import whole_number


def add_patient_commands(commands: Any) -> None:
    """Add the step `patient` to the steps of a session."""
    patient = commands.add_parser("patient", help="a simulated patient, for trying a session out")
    steps = patient.add_subparsers(required=True, metavar="STEP")
    setup = steps.add_parser("setup", help="write session.yaml and initial.csv")
    setup.add_argument("folder", type=Path)
    setup.set_defaults(run=_patient_setup)
    respond = steps.add_parser("respond", help="respond to the running trial: a recording and scores")
    respond.add_argument("session", type=Path)
    respond.add_argument("--folder", type=Path, default=Path(), help="where to write the recording")
    respond.set_defaults(run=_patient_respond)
    month = steps.add_parser("month", help="carry a session through the paper's protocol (resumable)")
    month.add_argument("session", type=Path)
    month.add_argument("--trials", type=whole_number, default=504, help="further trials over all targets")
    month.set_defaults(run=_patient_month)
    for step in (setup, respond, month):
        step.add_argument("--patient", type=whole_number, default=0, help="which patient (a seed)")
        step.add_argument("--dataset", type=Path, default=Path("data/spinal/stimulation.parquet"))


def _patient_setup(arguments: argparse.Namespace) -> None:
    from hdsafebo.session.patient.month import write_example
    from hdsafebo.session.patient.responses import load_responses

    for path in write_example(arguments.folder, load_responses(arguments.dataset), arguments.patient):
        print(path)


def _patient_respond(arguments: argparse.Namespace) -> None:
    from hdsafebo.session.patient.month import answer, simulated_patient
    from hdsafebo.session.patient.responses import load_responses
    from hdsafebo.session.session import Session

    session = Session.open(arguments.session)
    patient = simulated_patient(session, load_responses(arguments.dataset), arguments.patient)
    number, response = answer(session, patient)
    if response.recording is None:
        print("the recording went missing")
    else:
        path = arguments.folder / f"trial{number}.csv"
        path.write_bytes(response.recording)
        print(path)
    print(" ".join(f"{rater}={score:g}" for rater, score in response.scores.items()))


def _patient_month(arguments: argparse.Namespace) -> None:
    from hdsafebo.progress import progress
    from hdsafebo.session.patient.month import run_month, simulated_patient
    from hdsafebo.session.patient.month_result import evaluate_month
    from hdsafebo.session.patient.responses import load_responses
    from hdsafebo.session.session import Session

    session = Session.open(arguments.session)
    patient = simulated_patient(session, load_responses(arguments.dataset), arguments.patient)
    with progress(arguments.trials, "trials") as advance:
        run_month(session, patient, trials=arguments.trials, on_trial=lambda trial: advance())
    result = evaluate_month(session, patient)
    print(f"{result.recommended} recommended, {result.unsafe} of them rated unsafe")
    print(f"{result.breaches} trials outside the hard limits")
    for muscle, final in result.final_best.items():
        before, most = result.initial_best[muscle], result.reachable[muscle]
        print(f"  {muscle}: true selectivity {before:.3f} -> {final:.3f}, {most:.3f} within the priors")
