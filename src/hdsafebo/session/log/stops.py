"""Stops that wait for their place in the log.

A stop must be obeyed though the log is locked, the disk is slow or a suggestion is being computed. It is a
file of its own in the session's directory, which nobody else writes and for which no lock is needed: as long
as it is there, no trial starts. Whoever holds the log next writes the stop into it, and then removes the
file. Who presses holds the file's own lock until the words are in it, so that nobody takes in half of them.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import secrets
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from hdsafebo.files.atomic import replacing, sync_directory
from hdsafebo.files.bounded import open_regular
from hdsafebo.files.durable import make_durable_directory
from hdsafebo.session.errors import SessionError
from hdsafebo.session.words import LONGEST, LONGEST_NAME, trimmed_text

PREFIX = "STOP-"
_DAMAGED = "stop (its words were damaged)"
_UNDER_WAY = "stop (its words are being written)"


@dataclass(frozen=True)
class Stop:
    """A stop.

    Attributes:
        path: of its file.
        who, reason: as far as they were given.
        time: ISO 8601.
        complete: its words are all there, or will never be; while they are written no log takes it in.
    """

    path: Path
    who: str
    reason: str
    time: str
    complete: bool = True

    @property
    def token(self) -> str:
        """Tells it from every other stop; the log can hold it, whatever bytes the file is called by."""
        return os.fsencode(self.path.name).decode("utf-8", "backslashreplace")


def press(directory: Path, who: object, reason: object, time: datetime) -> Stop:
    """Stop a session, whatever its log is doing; on the disk when this returns.

    Args:
        directory: of the session.
        who, reason: anything; what can be kept of them is kept.
        time: now.

    Raises:
        SessionError: the directory cannot be written. As nothing can be appended to its log either, no trial
            can start from it.
    """
    words = {
        "who": trimmed_text(who, LONGEST_NAME, "unnamed"),
        "reason": trimmed_text(reason, LONGEST, "stop"),
        "time": time.isoformat(timespec="milliseconds"),
    }
    path = directory / f"{PREFIX}{time:%Y%m%dT%H%M%S}-{secrets.token_hex(8)}"
    locked = path.with_name(f".{path.name}")
    try:
        file = os.open(locked, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        try:
            with suppress(OSError):  # where no file can be locked, words may be lost, but no stop
                fcntl.flock(file, fcntl.LOCK_EX)
            os.rename(locked, path)  # from here on it is obeyed, however long the words take
            with suppress(OSError):  # a full disk: the file itself is the stop, its words are not needed
                os.write(file, _kept(**words))
                os.fsync(file)
                sync_directory(directory)
        finally:
            os.close(file)
    except OSError as error:
        raise SessionError(
            f"{path}: the stop cannot be kept ({error.strerror}); no trial can be started from here either, "
            "as nothing can be written"
        ) from None
    return Stop(path, words["who"], words["reason"], words["time"])


def pending(directory: Path) -> list[Stop]:
    """Stops that no log holds yet, the oldest first.

    Raises:
        SessionError: the directory cannot be listed, so that nobody knows whether a stop waits.
    """
    try:
        names = sorted(name for name in os.listdir(directory) if name.startswith(PREFIX))
    except OSError as error:
        raise SessionError(
            f"{directory}: whether the session was stopped cannot be seen "
            f"({error.strerror}), so that no trial may start"
        ) from None
    return [_read(directory / name) for name in names]


def hand_on(stops: Sequence[Stop], directory: Path) -> None:
    """Let stops wait in another directory, too, under the names that tell them from all others.

    Raises:
        OSError, WriteError: it cannot be written.
    """
    make_durable_directory(directory)
    for stop in stops:
        with replacing(directory / stop.path.name) as temporary:
            temporary.write_bytes(_kept(stop.who, stop.reason, stop.time))


def _kept(who: str, reason: str, time: str) -> bytes:
    """The words of a stop as its file holds them."""
    words = {"who": who, "reason": reason, "time": time}
    text = json.dumps(words, ensure_ascii=False).encode("utf-8", "replace")
    return hashlib.sha256(text).hexdigest().encode() + b" " + text


def _read(path: Path) -> Stop:
    """A stop, whatever its file holds."""
    try:
        with open_regular(path) as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            digest, _, text = file.read(4 * (LONGEST + LONGEST_NAME) + 1000).partition(b" ")
        if hashlib.sha256(text).hexdigest().encode() != digest:
            raise ValueError("damaged")
        words = json.loads(text)
        # A file that others wrote may hold anything; what no log can hold could never be taken in.
        who = trimmed_text(words["who"], LONGEST_NAME, "unnamed")
        reason = trimmed_text(words["reason"], LONGEST, "stop")
        return Stop(path, who, reason, trimmed_text(words["time"], LONGEST_NAME, ""))
    except BlockingIOError:
        return Stop(path, "unnamed", _UNDER_WAY, "", complete=False)
    except (OSError, ValueError, RecursionError, KeyError, TypeError):
        return Stop(path, "unnamed", _DAMAGED, "")
