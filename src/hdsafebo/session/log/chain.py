"""The audit log as a hash chain: each entry holds the hash of the one before it.

An entry is one line of canonical JSON; its hash is the SHA-256 of that line. Changing, removing or
reordering entries breaks the chain. Whoever can rewrite the whole file can also rebuild the chain, and a
cut tail leaves a valid shorter one: keep the head's hash (every report prints it) elsewhere to notice that.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from hdsafebo.session.errors import AuditError

START = "0" * 64
_KEYS = {"seq", "time", "who", "kind", "payload", "previous"}


@dataclass(frozen=True)
class Entry:
    """One entry of the log.

    Attributes:
        seq: number, from 1.
        time: UTC, ISO 8601.
        who: the person (or program) that acted.
        kind: what happened, such as `suggested`.
        payload: the facts, plain JSON.
        hash: SHA-256 of the entry's line, in hexadecimal digits.
    """

    seq: int
    time: str
    who: str
    kind: str
    payload: dict[str, Any]
    hash: str


def canonical(value: Any) -> bytes:
    """Canonical JSON: sorted keys, no spaces, UTF-8, finite numbers only; floats survive to the bit."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.encode("utf-8")


def seal(
    seq: int, time: str, who: str, kind: str, payload: dict[str, Any], previous: str
) -> tuple[bytes, Entry]:
    """The line of a new entry, and the entry."""
    line = canonical(
        {"seq": seq, "time": time, "who": who, "kind": kind, "payload": payload, "previous": previous}
    )
    return line, Entry(seq, time, who, kind, json.loads(line)["payload"], hashlib.sha256(line).hexdigest())


def check_chain(
    lines: Iterable[tuple[bytes, str]], *, after: Entry | None = None, source: str = "log"
) -> list[Entry]:
    """Check consecutive entries.

    Args:
        lines: (line, stored hash) pairs in order.
        after: the entry before the first one; None starts at the beginning.
        source: for messages.

    Raises:
        AuditError: an entry was changed, is missing, or is out of order; the message names the first one.
    """
    entries: list[Entry] = []
    previous, seq = (after.hash, after.seq) if after else (START, 0)
    for line, stored in lines:
        seq += 1
        digest = hashlib.sha256(line).hexdigest()
        if digest != stored:
            raise AuditError(
                f"{source}: entry {seq} was changed: hash {digest[:12]}, stored {str(stored)[:12]!r}"
            )
        data = _parse(line, seq, source)
        if data["seq"] != seq or data["previous"] != previous:
            raise AuditError(
                f"{source}: entry {seq} does not follow entry {seq - 1}: entries were removed, added or moved"
            )
        entries.append(Entry(seq, data["time"], data["who"], data["kind"], data["payload"], digest))
        previous = digest
    return entries


def write_lines(lines: Iterable[tuple[bytes, str]]) -> bytes:
    """The log as a text file: per entry its hash, a space, its line."""
    return b"".join(stored.encode() + b" " + line + b"\n" for line, stored in lines)


def read_lines(content: bytes, source: str = "log") -> list[Entry]:
    """Check a log written by `write_lines`; every byte of it counts.

    Raises:
        AuditError: any byte was changed, added or removed (a cut after a whole line apart).
    """
    if not content.endswith(b"\n"):
        raise AuditError(f"{source}: the last line is cut")
    pairs = []
    for number, row in enumerate(content[:-1].split(b"\n"), start=1):
        if len(row) < 66 or row[64:65] != b" ":
            raise AuditError(f"{source}: line {number} was changed: expected a hash, a space and an entry")
        pairs.append((row[65:], row[:64].decode("latin-1")))
    return check_chain(pairs, source=source)


def _parse(line: bytes, seq: int, source: str) -> dict[str, Any]:
    try:
        data = json.loads(line)
    except (ValueError, RecursionError):
        raise AuditError(f"{source}: entry {seq} is no JSON") from None
    if not isinstance(data, dict) or set(data) != _KEYS or not isinstance(data["payload"], dict):
        raise AuditError(f"{source}: entry {seq} is no log entry")
    return data
