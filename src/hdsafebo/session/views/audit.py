"""Checking a session: the chain of the log, the files it refers to, and that suggestions come out again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from hdsafebo.session.advice.advisor import Mismatch
from hdsafebo.session.errors import AuditError
from hdsafebo.session.log.chain import Entry, read_lines
from hdsafebo.session.log.state import fold
from hdsafebo.session.session import Session


@dataclass(frozen=True)
class Verdict:
    """A log that was found intact.

    Attributes:
        entries: how many.
        head: hash of the last one; compare it with one that was noted elsewhere.
        files: how many stored files it refers to.
        clock_steps: numbers of entries whose time lies before that of the entry before.
    """

    entries: int
    head: str
    files: int
    clock_steps: list[int]


def verify_session(session: Session, *, head: str | None = None) -> Verdict:
    """Check the whole log and every file that it refers to.

    Args:
        session: an open session.
        head: hash that was noted earlier; it must be in the log.

    Raises:
        AuditError: something was changed, cut or is missing.
    """
    entries = session.store.entries()
    session.store.check_integrity()
    hashes = _referenced(entries)
    for sha256 in hashes:
        session.store.file(sha256)
    return _verdict(entries, len(hashes), head)


def verify_export(path: Path, *, head: str | None = None) -> Verdict:
    """Check an exported log (`audit.log`) by itself; see `verify_session`."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise AuditError(f"{path}: cannot be read: {error.strerror or error}") from None
    entries = read_lines(content, str(path))
    fold(entries)
    return _verdict(entries, len(_referenced(entries)), head)


def replay(session: Session, on_entry: Callable[[Entry], None] = lambda entry: None) -> list[Mismatch]:
    """Compute every suggestion of the log again, from its first entry; returns those that differ."""
    session.refresh()
    advisor = session.new_advisor()
    for entry in session.entries:
        advisor.follow([entry])
        on_entry(entry)
    return advisor.mismatches


def _verdict(entries: list[Entry], files: int, head: str | None) -> Verdict:
    if not entries:
        raise AuditError("the log is empty")
    if head is not None and head not in [e.hash for e in entries]:
        raise AuditError(f"no entry has the noted hash {head[:12]}...: the log was cut or replaced")
    steps = [b.seq for a, b in pairwise(entries) if b.time < a.time]
    return Verdict(len(entries), entries[-1].hash, files, steps)


def _referenced(entries: list[Entry]) -> list[str]:
    """Hashes of the files that the log refers to."""
    hashes = []
    for entry in entries:
        if entry.kind == "created":
            hashes += [f["sha256"] for f in entry.payload["files"].values()]
        elif entry.kind == "recorded" and "recording" in entry.payload["details"]:
            hashes.append(entry.payload["details"]["recording"]["sha256"])
    return hashes
