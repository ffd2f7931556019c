"""Two copies of one log: whatever is whole in either counts.

A row proves itself by its hash and names the row before it, so the rows of both files can be thrown together
and put in order from the start: one damaged byte, one cut or one deleted file loses nothing. An entry is
acknowledged when it is in both files, the first one first. A writer that was killed may therefore leave an
incomplete last row, or a second file that is one entry behind: neither is damage.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from hdsafebo.session.errors import AuditError
from hdsafebo.session.log.chain import START, Entry, follow_on, read_row, rows

_MOST_BAD = 1000  # lines: a file with more of them is no log, and reading on could take hours
_SHOWN_BAD = 5
_BEGINNING = re.compile(rb"[0-9a-f]{0,63}|[0-9a-f]{64}( [^\n]*)?")


@dataclass(frozen=True)
class Reading:
    """What two copies of a log hold together.

    Attributes:
        entries: in order, complete.
        damage: what is wrong with either file, in words; the entries are complete all the same.
        tidy: both files hold these entries and nothing else.
    """

    entries: list[Entry]
    damage: list[str]
    tidy: bool


@dataclass
class _RowsFile:
    """The rows of one file.

    Attributes:
        good: entries whose rows are whole, in the order of the file.
        bad: numbers of lines that are not.
        tail: what a killed writer may have left behind the last row.
    """

    path: Path
    missing: bool = False
    good: list[Entry] = field(default_factory=list)
    bad: list[int] = field(default_factory=list)
    tail: bytes = b""


def read_copies(paths: Sequence[Path]) -> Reading:
    """Read both copies of a log.

    Args:
        paths: of the file that is written first, and of the second one.

    Raises:
        AuditError: an entry is whole in neither file, or the files are of different logs.
        OSError: a file that exists cannot be read.
    """
    files = [_read(path) for path in paths]
    entries = _in_order(files)
    damage = [
        text for i, file in enumerate(files) for text in _damage(file, entries, files[1 - i], second=i == 1)
    ]
    exact = [_is_exactly(file, entries) for file in files]
    if damage and not any(exact):
        _require_nothing_lost(files, entries)
    if all(file.tail.strip(b"\0") for file in files):  # the second file is begun when the first has its row
        raise AuditError(
            f"{files[0].path}: what follows entry {len(entries)} is cut in both copies of the log: "
            "restore the session from a backup"
        )
    tidy = not damage and all(exact) and not any(file.tail for file in files)
    return Reading(entries, damage, tidy)


def _read(path: Path) -> _RowsFile:
    file = _RowsFile(path)
    try:
        for number, row in enumerate(rows(path), start=1):
            if not row.endswith(b"\n"):
                file.tail = row
                continue
            if file.tail:  # a piece of an overlong line was no tail
                file.bad.append(number - 1)
                file.tail = b""
            try:
                file.good.append(read_row(row[:-1], f"{path}, line {number}"))
            except AuditError:
                file.bad.append(number)
                if len(file.bad) == _MOST_BAD:
                    break
    except FileNotFoundError:
        file.missing = True
    if file.tail and not _BEGINNING.fullmatch(file.tail.rstrip(b"\0")):
        file.bad.append(len(file.good) + len(file.bad) + 1)
        file.tail = b""
    return file


def _in_order(files: list[_RowsFile]) -> list[Entry]:
    """The entries of all files, each once, in the order of the chain."""
    followers: dict[str, Entry] = {}
    for file in files:
        for entry in file.good:
            known = followers.setdefault(entry.previous, entry)
            if known.hash != entry.hash:
                raise AuditError(
                    f"{file.path}: entry {entry.seq} is another one than in the other copy of the log"
                )
    entries: list[Entry] = []
    previous = START
    while previous in followers:
        entry = followers.pop(previous)
        entries.append(follow_on(entry, entries[-1] if entries else None, str(files[0].path)))
        previous = entry.hash
    if followers:
        first = min(followers.values(), key=lambda e: e.seq)
        raise AuditError(
            f"{files[0].path}: entry {len(entries) + 1} is damaged in both copies of the log, "
            f"though entry {first.seq} is there: restore the session from a backup"
        )
    return entries


def _is_exactly(file: _RowsFile, entries: list[Entry]) -> bool:
    """Whether a file holds the entries and no other row."""
    return not file.bad and [e.hash for e in file.good] == [e.hash for e in entries]


def _damage(file: _RowsFile, entries: list[Entry], other: _RowsFile, *, second: bool) -> list[str]:
    """What is wrong with a file that no killed writer leaves."""
    if file.missing:
        return [f"{file.path} is missing"] if entries else []
    if file.bad:
        more = len(file.bad) - _SHOWN_BAD
        shown = [f"{file.path}: line {number} is damaged" for number in file.bad[:_SHOWN_BAD]]
        return shown + [f"{file.path}: {more} further lines are damaged, or more"] * (more > 0)
    if [e.hash for e in file.good] != [e.hash for e in entries[: len(file.good)]]:
        return [f"{file.path}: rows are missing, repeated or moved"]
    behind = len(entries) - len(file.good)
    if behind > (1 if second else 0):
        return [f"{file.path}: ends after entry {len(file.good)} of {len(entries)}"]
    return []


def _require_nothing_lost(files: list[_RowsFile], entries: list[Entry]) -> None:
    """AuditError when rows behind the last whole entry are damaged in both files."""
    last = len(entries)
    if all(file.missing or any(number > last for number in file.bad) for file in files):
        raise AuditError(
            f"{files[0].path}: what follows entry {last} is damaged in both copies of the log: "
            "restore the session from a backup"
        )
