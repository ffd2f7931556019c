"""`hdsafebo session ...`: every step of a session on the command line."""

from __future__ import annotations

import argparse
import getpass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdsafebo.session.stream_option import ASK, add_stream_options, asked_values, recorded_stream

if TYPE_CHECKING:
    from hdsafebo.session.log.state import Trial
    from hdsafebo.session.session import Session

_POINT_HELP = "'4- 12+ 13+ at 2.5 mA' (stimulation; either half may be left out), or NAME=VALUE ... (else)"
_DESCRIPTION = (
    "Trials with a person in the loop. Research software, not a medical device: "
    "a qualified person decides about every trial."
)


def add_parser(subparsers: Any) -> None:
    """Add the subcommand `session` to the parsers of `hdsafebo`."""
    parser = subparsers.add_parser(
        "session", help="trials with a person in the loop", description=_DESCRIPTION
    )
    commands = parser.add_subparsers(required=True, metavar="STEP")

    def command(name: str, run: Any, text: str, *, writes: bool = True) -> argparse.ArgumentParser:
        step: argparse.ArgumentParser = commands.add_parser(
            name, help=text, description=f"{text}. {_DESCRIPTION}"
        )
        step.add_argument("session", type=Path, help="directory of the session")
        if writes:
            step.add_argument("--who", default=_user(), help="who acts (default: the user of this computer)")
        step.set_defaults(run=run)
        return step

    new = command("new", _new, "make a session")
    new.add_argument("definition", type=Path, help="session file (YAML)")
    new.add_argument("--initial", type=Path, help="initial trials, CSV or parquet")
    new.add_argument("--embedding", type=Path, help="embedding (.safetensors, its card beside it)")

    command("suggest", _suggest, "compute the next suggestion, or show the open one again")
    approve = command("approve", _approve, "accept the open suggestion")
    modify = command("modify", _modify, "deliver something else instead of the open suggestion")
    modify.add_argument("point", help=_POINT_HELP)
    refuse = command("refuse", _refuse, "turn the open suggestion down")
    for step in (approve, modify, refuse):
        step.add_argument("--suggestion", type=int, help="its number, to be sure which one is meant")
    manual = command("manual", _manual, "start a trial of one's own")
    manual.add_argument("point", help=_POINT_HELP)
    manual.add_argument("--reason", default="")

    record = command("record", _record, "record what came back from the running trial")
    record.add_argument(
        "values",
        nargs="+",
        metavar="NAME=VALUE",
        help=f"scores, or outcomes and safety values; `{ASK}` asks for those that are not given",
    )
    record.add_argument("--recording", type=Path, help="EMG recording, CSV, EDF or BDF")
    add_stream_options(record)
    record.add_argument("--remark", default="")
    lost = command("not-delivered", _not_delivered, "close the running trial: nothing was delivered")
    for step in (record, lost):
        step.add_argument("--trial", type=int, help="its number (default: the running one)")
    stop = command("stop", _stop, "let no trial start until resume")
    for step in (modify, refuse, lost, stop):
        step.add_argument("--reason", required=True)
    command("resume", _resume, "go on after a stop")
    switch = command("switch-target", _switch, "optimise another objective; all history is reused")
    switch.add_argument("target")
    note = command("note", _note, "keep a remark in the log")
    note.add_argument("text")

    command("status", _status, "show where the session stands", writes=False)
    export = command("export", _export, "write tables and log", writes=False)
    export.add_argument("folder", type=Path)
    export.add_argument("--recordings", action="store_true", help="write the recordings, too")
    report = command("report", _report, "write an HTML report", writes=False)
    report.add_argument("file", type=Path)
    verify = command(
        "verify", _verify, "check log and files (of a session, or an exported audit.log)", writes=False
    )
    verify.add_argument("--head", help="hash that was noted earlier; it must be in the log")
    command("replay", _replay, "compute every suggestion of the log again and compare", writes=False)

    serve = command("serve", _serve, "open the page for the person at the bench", writes=False)
    serve.add_argument("--host", default="127.0.0.1", help="other than loopback needs the printed token")
    serve.add_argument("--port", type=int, default=8765)
    _add_patient(commands)


def _user() -> str:
    """Name of the user of this computer; empty where it has none, so that `--who` is asked for."""
    try:
        return getpass.getuser()
    except (OSError, KeyError):
        return ""


def _add_patient(commands: Any) -> None:
    """The simulated patient."""
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
    month.add_argument("--trials", type=int, default=504, help="further trials over all targets")
    month.set_defaults(run=_patient_month)
    for step in (setup, respond, month):
        step.add_argument("--patient", type=int, default=0, help="which patient (a seed)")
        step.add_argument("--dataset", type=Path, default=Path("data/spinal/stimulation.parquet"))


def _open(arguments: argparse.Namespace) -> Session:
    from hdsafebo.session.session import Session

    return Session.open(arguments.session)


def _new(arguments: argparse.Namespace) -> None:
    from hdsafebo.session.create import create_session

    session = create_session(
        arguments.session,
        arguments.definition,
        who=arguments.who,
        initial=arguments.initial,
        embedding=arguments.embedding,
    )
    print(_DESCRIPTION)
    print(f"{arguments.session}: session {session.state.session}, {len(session.state.trials)} initial trials")


def _suggest(arguments: argparse.Namespace) -> None:
    from hdsafebo.session.views.summary import promised

    session = _open(arguments)
    suggestion = session.suggest(arguments.who)
    belief = suggestion.belief
    objective = belief["objective"]
    print(
        f"suggestion {suggestion.number} for {suggestion.target}: {session.space.describe(suggestion.point)}"
    )
    low, high = (objective["mean"] + k * objective["sd"] for k in (-2, 2))
    print(f"  predicted {suggestion.target}: {objective['mean']:.3f}, {low:.3f} to {high:.3f} (two sd)")
    for name, value in belief["safety"].items():
        print(f"  predicted {name}: {value['mean']:.2f}, {value['low']:.2f} to {value['high']:.2f}")
    alpha = promised(session)["alpha"]
    print(f"  safe with probability {belief['safe_probability']:.3f} (the method promises {alpha:.3f})")
    if belief["marked_unsafe"]:
        print("  NOT BELIEVED SAFE: nothing is; this is the most probably safe trial")


def _approve(arguments: argparse.Namespace) -> None:
    session = _open(arguments)
    _started(session, session.approve(arguments.who, arguments.suggestion))


def _modify(arguments: argparse.Namespace) -> None:
    session = _open(arguments)
    suggestion = session.state.open_suggestion
    point = session.space.parse(arguments.point, None if suggestion is None else suggestion.point)
    _started(session, session.modify(arguments.who, point, arguments.reason, arguments.suggestion))


def _refuse(arguments: argparse.Namespace) -> None:
    suggestion = _open(arguments).refuse(arguments.who, arguments.reason, arguments.suggestion)
    print(f"suggestion {suggestion.number} is refused; it will not be made again")


def _manual(arguments: argparse.Namespace) -> None:
    session = _open(arguments)
    point = session.space.parse(arguments.point, None)
    _started(session, session.manual(arguments.who, point, arguments.reason))


def _started(session: Session, trial: Trial) -> None:
    print(f"trial {trial.number} may be delivered: {session.space.describe(trial.point)}; record it next")


def _record(arguments: argparse.Namespace) -> None:
    from hdsafebo.files.bounded import read_bounded
    from hdsafebo.session.errors import RecordingError
    from hdsafebo.session.measuring.recording import MAX_BYTES
    from hdsafebo.session.spaces.space import Report

    session = _open(arguments)
    values: dict[str, float] = {}
    for word in (word for word in arguments.values if word != ASK):
        name, equals, number = word.partition("=")
        try:
            values[name] = float(number)
        except ValueError:
            raise RecordingError(f"{word!r}: expected NAME=VALUE with a number") from None
        if not equals:
            raise RecordingError(f"{word!r}: expected NAME=VALUE")
    path = arguments.recording
    if arguments.stream is not None:
        path = recorded_stream(session, arguments, values)
    if ASK in arguments.values:
        values = asked_values(session, values, path)
    recording = None if path is None else (read_bounded(path, MAX_BYTES, RecordingError), path.name)
    trial = session.record(arguments.who, Report(recording, values), arguments.trial, remark=arguments.remark)
    _recorded(session, trial)


def _recorded(session: Session, trial: Trial) -> None:
    from hdsafebo.session.views.summary import is_unsafe

    outcomes = trial.outcomes or {}
    shown = ", ".join(f"{k} {v:.3f}" for k, v in outcomes.items() if k == trial.target) or trial.failure
    safety = ", ".join(f"{k} {v:g}" for k, v in (trial.safety or {}).items()) or "no safety value"
    mark = ", UNSAFE" if is_unsafe(session, trial) else ""
    print(f"trial {trial.number} is recorded: {shown}; {safety}{mark}")


def _not_delivered(arguments: argparse.Namespace) -> None:
    trial = _open(arguments).not_delivered(arguments.who, arguments.reason, arguments.trial)
    print(f"trial {trial.number} is closed: not delivered")


def _stop(arguments: argparse.Namespace) -> None:
    _open(arguments).stop(arguments.who, arguments.reason)
    print("the session is stopped: no trial starts until it is resumed")


def _resume(arguments: argparse.Namespace) -> None:
    _open(arguments).resume(arguments.who)
    print("the session goes on; steps are limited from the start values again")


def _switch(arguments: argparse.Namespace) -> None:
    session = _open(arguments)
    session.switch_target(arguments.who, arguments.target)
    print(f"the target is {session.state.target}; {len(session.state.trials)} trials are reused")


def _note(arguments: argparse.Namespace) -> None:
    _open(arguments).note(arguments.who, arguments.text)
    print("noted")


def _status(arguments: argparse.Namespace) -> None:
    from hdsafebo.session.views.summary import status

    data = status(_open(arguments))
    print(f"{data['name']} ({data['kind']}), session {data['session']}")
    print(f"  target {data['target']} of {', '.join(data['targets'])}")
    counted = data["counts"]
    print("  " + ", ".join(f"{value} {key.replace('_', ' ')}" for key, value in counted.items()))
    if data["best"] is not None:
        best = data["best"]
        print(f"  best safe: trial {best['number']}, {best['text']}, {best['outcomes'][data['target']]:.3f}")
    if data["stopped"] is not None:
        print(f"  STOPPED: {data['stopped']}")
    if data["running"] is not None:
        print(f"  trial {data['running']['number']} waits for its record: {data['running']['text']}")
    elif data["suggestion"] is not None:
        print(
            f"  suggestion {data['suggestion']['number']} waits for a decision: {data['suggestion']['text']}"
        )
    print(f"  log: {data['head']['seq']} entries, head {data['head']['hash']}")


def _export(arguments: argparse.Namespace) -> None:
    from hdsafebo.session.views.export import export_session

    for path in export_session(_open(arguments), arguments.folder, recordings=arguments.recordings):
        print(path)


def _report(arguments: argparse.Namespace) -> None:
    from hdsafebo.session.views.report import write_report

    print(write_report(_open(arguments), arguments.file))


def _verify(arguments: argparse.Namespace) -> None:
    from hdsafebo.session.views.audit import verify_export, verify_session

    path = arguments.session
    verdict = (
        verify_export(path, head=arguments.head)
        if path.is_file()
        else verify_session(_open(arguments), head=arguments.head)
    )
    print(f"intact: {verdict.entries} entries, {verdict.files} files, head {verdict.head}")
    for seq in verdict.clock_steps:
        print(f"note: the clock went back before entry {seq}")


def _replay(arguments: argparse.Namespace) -> None:
    from hdsafebo.progress import progress
    from hdsafebo.session.errors import AuditError
    from hdsafebo.session.views.audit import replay

    session = _open(arguments)
    with progress(len(session.entries), "replay") as advance:
        mismatches = replay(session, lambda entry: advance())
    if mismatches:
        numbers = ", ".join(str(m.suggestion) for m in mismatches)
        raise AuditError(f"{len(mismatches)} suggestions were not reproduced: {numbers}")
    print(f"{len(session.state.suggestions)} suggestions reproduced, to the bit")


def _serve(arguments: argparse.Namespace) -> None:
    from hdsafebo.session.web.server import serve

    serve(arguments.session, arguments.host, arguments.port)


def _patient_setup(arguments: argparse.Namespace) -> None:
    from hdsafebo.session.patient.month import write_example
    from hdsafebo.session.patient.responses import load_responses

    for path in write_example(arguments.folder, load_responses(arguments.dataset), arguments.patient):
        print(path)


def _patient_respond(arguments: argparse.Namespace) -> None:
    from hdsafebo.session.patient.month import answer, simulated_patient
    from hdsafebo.session.patient.responses import load_responses

    session = _open(arguments)
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

    session = _open(arguments)
    patient = simulated_patient(session, load_responses(arguments.dataset), arguments.patient)
    with progress(arguments.trials, "trials") as advance:
        run_month(session, patient, trials=arguments.trials, on_trial=lambda trial: advance())
    result = evaluate_month(session, patient)
    print(f"{result.recommended} recommended, {result.unsafe} of them rated unsafe")
    print(f"{result.breaches} trials outside the hard limits")
    for muscle, final in result.final_best.items():
        before, most = result.initial_best[muscle], result.reachable[muscle]
        print(f"  {muscle}: true selectivity {before:.3f} -> {final:.3f}, {most:.3f} within the priors")
