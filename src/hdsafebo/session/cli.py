"""`hdsafebo session ...`: every step of a session on the command line."""

from __future__ import annotations

import argparse
import getpass
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdsafebo.session.patient.commands import add_patient_commands
from hdsafebo.session.stream_option import ASK, add_stream_options, asked_values, recorded_stream
from hdsafebo.session.words import whole_number

if TYPE_CHECKING:
    from hdsafebo.session.log.state import LoggedTrial
    from hdsafebo.session.session import Session

_POINT_HELP = "'4- 12+ 13+ at 2.5 mA' (stimulation; either half may be left out), or NAME=VALUE ... (else)"
_DESCRIPTION = (
    "Trials with a person in the loop. Research software, no medical device and no safety system: "
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
        step.add_argument(
            "--suggestion",
            type=whole_number,
            required=True,
            help="number of the suggestion that you have seen",
        )
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
        step.add_argument("--trial", type=whole_number, required=True, help="its number")
    stop = command("stop", _stop, "let no trial start until resume")
    stop.add_argument("--reason", default="stop")
    for step in (modify, refuse, lost):
        step.add_argument("--reason", required=True)
    command("resume", _resume, "go on after a stop")
    switch = command("switch-target", _switch, "optimise another objective; all history is reused")
    switch.add_argument("target")
    note = command("note", _note, "keep a remark in the log")
    note.add_argument("text")

    tighten = command("tighten", _tighten, "let the tighter hard limits of a session file hold from now on")
    tighten.add_argument("definition", type=Path, help="session file (YAML) that differs in nothing else")
    tighten.add_argument("--reason", default="")

    backup = command("backup", _backup, "copy the session, also while others work in it", writes=False)
    backup.add_argument("target", type=Path, help="a directory that does not exist")
    command("repair", _repair, "restore damaged copies of log and files from the other copies", writes=False)
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
    serve.add_argument("--port", type=whole_number, default=8765)
    add_patient_commands(commands)


def _user() -> str:
    """Name of the user of this computer; empty where it has none, so that `--who` is asked for."""
    try:
        return getpass.getuser()
    except (OSError, KeyError):
        return ""


def _open(arguments: argparse.Namespace, *, read_only: bool = False) -> Session:
    from hdsafebo.session.session import Session

    session = Session.open(arguments.session, read_only=read_only)
    for notice in session.store.notices:
        print(f"note: {notice}; nothing is lost, the other copy holds it", file=sys.stderr)
    return session


def _new(arguments: argparse.Namespace) -> None:
    from hdsafebo.session.create import create_session

    session = create_session(
        arguments.session,
        arguments.definition,
        who=arguments.who,
        initial=arguments.initial,
        embedding=arguments.embedding,
    )
    print(session.disclaimer)
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
    from hdsafebo.session.rules import open_suggestion

    session = _open(arguments)
    suggestion = open_suggestion(session.state, arguments.suggestion)
    point = session.space.parse(arguments.point, suggestion.point)
    _started(session, session.modify(arguments.who, point, arguments.reason, arguments.suggestion))


def _refuse(arguments: argparse.Namespace) -> None:
    suggestion = _open(arguments).refuse(arguments.who, arguments.reason, arguments.suggestion)
    print(f"suggestion {suggestion.number} is refused; it will not be made again")


def _manual(arguments: argparse.Namespace) -> None:
    session = _open(arguments)
    point = session.space.parse(arguments.point, None)
    _started(session, session.manual(arguments.who, point, arguments.reason))


def _started(session: Session, trial: LoggedTrial) -> None:
    print(f"trial {trial.number} may be delivered: {session.space.describe(trial.point)}; record it next")


def _record(arguments: argparse.Namespace) -> None:
    from hdsafebo.files.bounded import read_bounded
    from hdsafebo.session.errors import ProtocolError, RecordingError
    from hdsafebo.session.measuring.recording import MAX_BYTES
    from hdsafebo.session.spaces.space import Report
    from hdsafebo.session.words import parse_assignments

    session = _open(arguments)
    try:
        values = parse_assignments([word for word in arguments.values if word != ASK])
    except ProtocolError as error:
        raise RecordingError(str(error)) from None
    path = arguments.recording
    if arguments.stream is not None:
        path = recorded_stream(session, arguments, values)
    if ASK in arguments.values:
        values = asked_values(session, values, path)
    recording = None if path is None else (read_bounded(path, MAX_BYTES, RecordingError), path.name)
    trial = session.record(arguments.who, Report(recording, values), arguments.trial, remark=arguments.remark)
    _recorded(session, trial)


def _recorded(session: Session, trial: LoggedTrial) -> None:
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
    """Stop first; whether there is a session that can be opened is asked later."""
    from hdsafebo.session.log.stops import press
    from hdsafebo.session.log.store import utc_now

    press(arguments.session, arguments.who, arguments.reason, utc_now())
    print("the session is stopped: no trial starts until it is resumed", flush=True)
    if _open(arguments).store.adopt_stops():
        print("note: the log is held by another program; the stop is written into it with the next step")


def _resume(arguments: argparse.Namespace) -> None:
    _open(arguments).resume(arguments.who)
    print("the session goes on; steps are limited from the start values again")


def _switch(arguments: argparse.Namespace) -> None:
    session = _open(arguments)
    session.switch_target(arguments.who, arguments.target)
    print(f"the target is {session.state.target}; {len(session.state.trials)} trials are reused")


def _tighten(arguments: argparse.Namespace) -> None:
    session = _open(arguments)
    for place, before, after in session.tighten(arguments.who, arguments.definition, arguments.reason):
        print(f"{place}: {before!r} -> {after!r}")
    print("these limits hold from now on; steps are limited from the start values again")


def _backup(arguments: argparse.Namespace) -> None:
    head = _open(arguments).store.back_up(arguments.target)
    print(f"{arguments.target}: {head.seq} entries, head {head.hash}")


def _repair(arguments: argparse.Namespace) -> None:
    from hdsafebo.session.log.store import Store

    store = Store(arguments.session)
    mended = [*store.notices, *store.repair()]
    for text in dict.fromkeys(mended):
        print(f"restored: {text}")
    print("everything is there in two copies")


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
    for trial in data["running"]:
        print(f"  trial {trial['number']} waits for its record: {trial['text']}")
    if data["suggestion"] is not None:
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
        else verify_session(_open(arguments, read_only=True), head=arguments.head)
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
