"""Checking a session: the chain of its log, the rules, its files, and that suggestions come out again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from hdsafebo.session.advice.advisor import Mismatch
from hdsafebo.session.advice.setup import make_space
from hdsafebo.session.definition import parse_definition
from hdsafebo.session.errors import AuditError, SessionError
from hdsafebo.session.files import NamedFile, stored_files
from hdsafebo.session.log.chain import Entry, read_log
from hdsafebo.session.log.layout import referenced
from hdsafebo.session.log.state import State
from hdsafebo.session.rules import Rules
from hdsafebo.session.session import Session
from hdsafebo.session.words import shown


@dataclass(frozen=True)
class IntactLog:
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


def verify_session(session: Session, *, head: str | None = None) -> IntactLog:
    """Check both copies of the whole log, every step by the rules, and both copies of every file.

    Args:
        session: an open session.
        head: hash that was noted earlier; it must be in the log.

    Raises:
        AuditError: something was changed, cut or is missing, or a step was not permitted.
    """
    entries = session.store.entries()
    digests = referenced(entries)
    wrong = session.store.attachments.damage(digests)
    if wrong:
        raise AuditError(f"{'; '.join(wrong)}. `hdsafebo session repair` restores what the other copy holds")
    check_rules(entries, stored_files(session.store, entries[0].payload["files"]))
    return _verdict(entries, len(digests), head)


def verify_export(path: Path, *, head: str | None = None) -> IntactLog:
    """Check a single log (`audit.log`) by itself; see `verify_session`."""
    try:
        entries = read_log(path)
    except OSError as error:
        raise AuditError(f"{path}: cannot be read: {error.strerror or error}") from None
    if not entries:
        raise AuditError(f"{path}: the log is empty")
    try:
        check_rules(entries)
    except SessionError as error:
        raise AuditError(f"{path}: {error}") from None
    return _verdict(entries, len(referenced(entries)), head)


def check_rules(entries: list[Entry], files: Mapping[str, NamedFile] | None = None) -> State:
    """Apply the rules of the protocol to every entry of a log; the state that they add up to.

    Args:
        entries: the log.
        files: that the session was made with; without them a list's own rows are not known.

    Raises:
        AuditError: an entry breaks a rule; the message names the first one.
    """
    state = State()
    try:
        definition = parse_definition(entries[0].payload.get("definition", {}), source="log entry 1")
        rules = Rules(make_space(definition, files), make_space(definition))
        for entry in entries:
            rules.check(state, entry.kind, entry.payload)
            rules.apply(state, entry)
    except AuditError:
        raise
    except SessionError as error:
        raise AuditError(_broken(state, entries, error)) from None
    return state


def _broken(state: State, entries: list[Entry], error: SessionError) -> str:
    entry = entries[state.head.seq if state.head else 0]
    return f"log entry {entry.seq} ({entry.kind}) was not permitted: {shown(str(error))}"


def replay(session: Session, on_entry: Callable[[Entry], None] = lambda entry: None) -> list[Mismatch]:
    """Compute every suggestion of the log again, from its first entry; returns those that differ."""
    session.refresh()
    advisor = session.new_advisor()
    for entry in session.entries:
        advisor.follow([entry])
        on_entry(entry)
    return advisor.mismatches


def _verdict(entries: list[Entry], files: int, head: str | None) -> IntactLog:
    if head is not None and head not in [e.hash for e in entries]:
        raise AuditError(f"no entry has the noted hash {head[:12]}...: the log was cut or replaced")
    steps = [b.seq for a, b in pairwise(entries) if b.time < a.time]
    return IntactLog(len(entries), entries[-1].hash, files, steps)
