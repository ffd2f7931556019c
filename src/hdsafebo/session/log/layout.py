"""Where the files of a session lie, and writing a whole one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from hdsafebo.files.atomic import WriteError, replacing
from hdsafebo.files.durable import make_durable_directory
from hdsafebo.session.errors import SessionError
from hdsafebo.session.log.attachments import Attachments
from hdsafebo.session.log.chain import Entry, write_rows

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


def write_session(root: Path, entries: list[Entry], files: Iterable[bytes]) -> None:
    """Write a log and its files into a directory; the original log comes last and makes it a session.

    Raises:
        SessionError: the directory cannot be written.
    """
    try:
        attachments = attachments_of(root)
        for content in files:
            attachments.add(content)
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
