"""The audit log as a hash chain: each entry holds the hash of the one before it.

An entry is one line of canonical JSON; its hash is the SHA-256 of that line. A log file has one row per
entry: the hash, a space, the line. Changing, removing or reordering entries breaks the chain. Whoever can
rewrite the whole file can also rebuild the chain, and a cut tail leaves a valid shorter one: keep the head's
hash (every report prints it) elsewhere to notice that.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdsafebo.files.bounded import open_regular
from hdsafebo.session.errors import AuditError
from hdsafebo.session.log.payloads import KINDS, check_payload

START = "0" * 64
MAX_ENTRY_BYTES = 64 * 2**20
MAX_LOG_BYTES = 512 * 2**20
_KEYS = {"seq", "time", "who", "kind", "payload", "previous"}
_HASH = re.compile(r"[0-9a-f]{64}")
_TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{1,6})?\+00:00", re.ASCII)
_LONGEST_WHO = 200


@dataclass(frozen=True)
class Entry:
    """One entry of the log.

    Attributes:
        seq: number, from 1.
        time: UTC, ISO 8601.
        who: the person (or program) that acted.
        kind: what happened, such as `suggested`.
        payload: the facts, plain JSON.
        previous: hash of the entry before.
        hash: SHA-256 of the entry's line, in hexadecimal digits.
    """

    seq: int
    time: str
    who: str
    kind: str
    payload: dict[str, Any]
    previous: str
    hash: str


def canonical(value: Any) -> bytes:
    """Canonical JSON: sorted keys, no spaces, UTF-8, finite numbers only; floats survive to the bit."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.encode("utf-8")


def seal(seq: int, time: str, who: str, kind: str, payload: dict[str, Any], previous: str) -> Entry:
    """A new entry.

    Raises:
        AuditError: the payload is not what entries of its kind hold.
    """
    try:
        line = canonical(
            {"seq": seq, "time": time, "who": who, "kind": kind, "payload": payload, "previous": previous}
        )
    except (TypeError, ValueError) as error:  # no plain data, or a name of a file that is no UTF-8
        raise AuditError(f"log entry {seq} ({kind}): cannot be written: {error}") from None
    return read_line(line, f"log entry {seq}")


def row_of(entry: Entry) -> bytes:
    """The row of an entry in a log file, with its line break."""
    line = canonical(
        {
            "seq": entry.seq,
            "time": entry.time,
            "who": entry.who,
            "kind": entry.kind,
            "payload": entry.payload,
            "previous": entry.previous,
        }
    )
    return entry.hash.encode() + b" " + line + b"\n"


def write_rows(entries: list[Entry]) -> bytes:
    """The content of a log file."""
    return b"".join(map(row_of, entries))


def read_line(line: bytes, source: str) -> Entry:
    """The entry of a line, every field checked; AuditError names what is wrong."""
    try:
        data = json.loads(line)
        honest = canonical(data) == line
    except (ValueError, RecursionError):
        raise AuditError(f"{source}: no JSON") from None
    if not honest or not isinstance(data, dict) or set(data) != _KEYS:
        raise AuditError(f"{source}: no log entry in canonical form")
    _check_fields(data, source)
    check_payload(data["kind"], data["payload"], source)
    return Entry(**data, hash=hashlib.sha256(line).hexdigest())


def _check_fields(data: dict[str, Any], source: str) -> None:
    seq, who = data["seq"], data["who"]
    good = {
        "seq": isinstance(seq, int) and not isinstance(seq, bool) and seq > 0,
        "time": isinstance(data["time"], str) and _TIME.fullmatch(data["time"]) is not None,
        "who": isinstance(who, str) and 0 < len(who) <= _LONGEST_WHO,
        "kind": data["kind"] in KINDS if isinstance(data["kind"], str) else False,
        "previous": isinstance(data["previous"], str) and _HASH.fullmatch(data["previous"]) is not None,
    }
    for key, ok in good.items():
        if not ok:
            raise AuditError(f"{source}: {key} is {str(data[key])[:60]!r}, which no entry of a log has")


def read_row(row: bytes, source: str) -> Entry:
    """The entry of a row without its line break; AuditError when a byte of the row was changed."""
    if len(row) < 66 or row[64:65] != b" ":
        raise AuditError(f"{source}: was changed: expected a hash, a space and an entry")
    if hashlib.sha256(row[65:]).hexdigest().encode() != row[:64]:
        raise AuditError(f"{source}: was changed: its hash is another one")
    return read_line(row[65:], source)


def follow_on(entry: Entry, before: Entry | None, source: str) -> Entry:
    """The entry; AuditError unless it is the one behind `before` (None: the first one)."""
    seq, previous = (before.seq, before.hash) if before else (0, START)
    if entry.seq != seq + 1 or entry.previous != previous:
        raise AuditError(
            f"{source}: entry {entry.seq} does not follow entry {seq}: entries were removed, added or moved"
        )
    return entry


def rows(path: Path, start: int = 0) -> Iterator[bytes]:
    """The rows of a log file from a byte on, with their line breaks; a cut one, or a piece, has none.

    No more than an entry's greatest size is held in memory.

    Raises:
        AuditError: the file is larger than any log.
        OSError: it cannot be read.
    """
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size > MAX_LOG_BYTES:
            raise AuditError(f"{path}: {size} bytes, expected at most {MAX_LOG_BYTES}")
        file.seek(start)
        while row := file.readline(MAX_ENTRY_BYTES):
            yield row


def read_log(path: Path) -> list[Entry]:
    """All entries of one log file; every byte counts.

    Raises:
        AuditError: the file is too large, or a byte was changed, added or removed (a cut after a whole row
            apart); the message names the first wrong line.
        OSError: the file cannot be read.
    """
    entries: list[Entry] = []
    for number, row in enumerate(rows(path), start=1):
        source = f"{path}, line {number}"
        if not row.endswith(b"\n"):
            raise AuditError(f"{source}: the last line is cut, or longer than {MAX_ENTRY_BYTES} bytes")
        entries.append(follow_on(read_row(row[:-1], source), entries[-1] if entries else None, source))
    return entries
