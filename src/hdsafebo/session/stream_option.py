"""`session record --stream`: the recording comes from a Lab Streaming Layer stream instead of a file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from hdsafebo.session.errors import RecordingError, SessionError
from hdsafebo.session.words import number, parse_number

if TYPE_CHECKING:
    from hdsafebo.session.session import Session

ASK = "ask"  # instead of values: a score is known when the trial is over
_DEFAULT_S = 2.0


def add_stream_options(record: argparse.ArgumentParser) -> None:
    """Add the options to the step `record`."""
    record.add_argument(
        "--stream",
        help="name of a Lab Streaming Layer stream to record instead of a file; the recording is kept as "
        "trialNUMBER.csv in this folder",
    )
    record.add_argument(
        "--seconds",
        type=number,
        default=_DEFAULT_S,
        help=f"how long to record the stream (default: {_DEFAULT_S:g})",
    )
    record.add_argument("--markers", help="name of a stream of markers, which become annotations")


def recorded_stream(session: Session, arguments: argparse.Namespace, values: dict[str, float]) -> Path:
    """Record the running trial from the stream; returns the file, which stays whatever becomes of the record.

    Args:
        session: with a running trial.
        arguments: of the command line.
        values: that were given.

    Raises:
        SessionError: nothing is to be recorded, a value is missing, the file exists, or the stream is not as
            it should be.
    """
    from hdsafebo.session.definition import StimulationDefinition
    from hdsafebo.session.measuring.live import record_stream

    definition, running = session.definition, session.state.running
    if not isinstance(definition, StimulationDefinition):
        raise SessionError("--stream: this kind of session takes values, no recordings")
    if arguments.recording is not None:
        raise SessionError("--stream and --recording: expected one of them")
    if running is None or arguments.trial not in (None, running.number):
        raise SessionError("--stream: that trial is not running: approve a suggestion or start one first")
    missing = [name for name in session.space.entries if name not in values]
    if missing and ASK not in arguments.values:
        raise SessionError(f"{', '.join(missing)} missing: expected NAME=VALUE, or `{ASK}` to be asked later")
    path = Path(f"trial{running.number}.csv")
    if path.exists():
        raise SessionError(f"{path} exists already: record it with --recording, or move it away")
    content = record_stream(
        arguments.stream,
        arguments.seconds,
        definition.emg,
        {"session": session.state.session, "trial": str(running.number)},
        markers=arguments.markers,
        on_start=lambda: print(f"recording for {arguments.seconds:g} s: deliver the trial now", flush=True),
    )
    try:
        with path.open("xb") as file:
            file.write(content)
    except OSError as error:
        raise SessionError(f"{path}: cannot be written: {error.strerror or error}") from None
    print(path)
    return path


def asked_values(session: Session, given: dict[str, float], recording: Path | None) -> dict[str, float]:
    """The values that were given, and those that the person enters now.

    Args:
        session: whose values are asked for.
        given: values by name.
        recording: of the trial, if there is one; nobody has lost it when nobody answers.

    Raises:
        RecordingError: nobody answers.
    """
    values = dict(given)
    for name in session.space.entries:
        while name not in values:
            try:
                text = input(f"{name}: ")
            except EOFError:
                kept = "" if recording is None else f"--recording {recording} "
                raise RecordingError(f"{name} is missing: record it with {kept}{name}=VALUE") from None
            number = parse_number(text.strip())
            if number is None:
                print(f"{text!r} is no number")
            else:
                values[name] = number
    return values
