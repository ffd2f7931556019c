"""Where the files of a session lie, and writing a whole one."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from hdsafebo.files.atomic import WriteError, replacing
from hdsafebo.files.durable import append_durably, is_in_place, make_durable_directory
from hdsafebo.session.errors import SessionError
from hdsafebo.session.log.attachments import Attachments
from hdsafebo.session.log.chain import Entry, write_rows
from hdsafebo.session.log.stops import Stop, hand_on

ORIGINAL, COPY, LOG, FILES, LOCK = "original", "copy", "audit.log", "files", "lock"


def log_paths(root: Path) -> list[Path]:
    """Both copies of the log, in the order in which they are written."""
    return [root / name / LOG for name in (ORIGINAL, COPY)]


def attachments_of(root: Path) -> Attachments:
    """The files that the log refers to."""
    return Attachments([root / name / FILES for name in (ORIGINAL, COPY)])


def referenced(entries: Sequence[Entry]) -> list[str]:
    """Digests of the files that a log refers to, each once."""
    digests = []
    for entry in entries:
        if entry.kind == "created":
            digests += [f["sha256"] for f in entry.payload["files"].values()]
        elif entry.kind == "recorded" and entry.payload["details"].get("recording") is not None:
            digests.append(entry.payload["details"]["recording"]["sha256"])
    return list(dict.fromkeys(digests))


def write_session(
    root: Path, entries: list[Entry], files: Iterable[bytes], stops: Sequence[Stop] = ()
) -> None:
    """Write a log and its files into a directory; the original log comes last and makes it a session.

    Args:
        root: the directory.
        entries: of the log.
        files: contents that the entries refer to.
        stops: that wait for their place in the log.

    Raises:
        SessionError: the directory cannot be written.
    """
    try:
        attachments = attachments_of(root)
        for content in files:
            attachments.add(content)
        hand_on(stops, root)
        for path in reversed(log_paths(root)):
            replace_log(path, write_rows(entries), keep=False)
    except (OSError, WriteError) as error:
        raise SessionError(f"{root}: cannot be written: {error}") from None


def replace_log(path: Path, content: bytes, *, keep: bool) -> None:
    """Give a log file its content, whole; what it held before is kept beside it if asked.

    Raises:
        OSError, WriteError: it cannot be written.
    """
    make_durable_directory(path.parent)
    if keep and path.exists():
        number = sum(p.name.startswith(f"{path.name}.damaged") for p in path.parent.iterdir()) + 1
        path.rename(path.with_name(f"{path.name}.damaged-{number}"))
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def append_to_all(paths: Sequence[Path], end: int, row: bytes) -> bool:
    """Append a row to every file, or to none of them.

    The session's lock keeps others from writing, unless somebody has removed its file meanwhile: the first
    log is locked as well, and nothing is written over what has come behind `end`.

    Returns:
        Whether it was appended; False when another program has appended something.

    Raises:
        OSError: a file is gone or cannot be written.
    """
    files: list[int] = []
    try:
        files += [os.open(path, os.O_RDWR | os.O_CLOEXEC) for path in paths]
        fcntl.flock(files[0], fcntl.LOCK_EX)
        if any(os.fstat(file).st_size != end for file in files):
            return False
        try:
            for file in files:
                append_durably(file, end, row)
            for path, file in zip(paths, files, strict=True):
                if not is_in_place(path, file):
                    raise FileNotFoundError(2, "was replaced", str(path))
        except OSError:
            for file in files:
                with suppress(OSError):
                    os.ftruncate(file, end)
            raise
        return True
    finally:
        for file in files:
            os.close(file)
