"""Sessions of the former format, one SQLite file: read once, checked, and written in the present format.

What was `session.db` is kept as `session.db.converted`. Nothing of the database is trusted: its tables must
be exactly those that sessions had, every entry proves itself by its hash, and the write-ahead log, whose
damaged end SQLite drops in silence, is checked frame by frame.
"""

from __future__ import annotations

import atexit
import hashlib
import shutil
import sqlite3
import struct
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from hdsafebo.files.bounded import read_bytes
from hdsafebo.session.errors import AuditError, SessionError
from hdsafebo.session.log.cache import Cache
from hdsafebo.session.log.chain import Entry, follow_on, read_row, seal
from hdsafebo.session.log.layout import log_paths, referenced, write_session

FILE_NAME = "session.db"
MAX_BYTES = 8 * 2**30
_SIDE_FILES = ("", "-wal", "-shm")
_APPLICATION = 0x48445342  # marked a file as a session's in SQLite's header
_VERSION = 1
_CACHED = ("optimiser before", "optimiser after")
_SIGNATURE_BYTES = 32
_KEPT = "BEGIN SELECT RAISE(ABORT, 'the log is append-only'); END"
_SCHEMA = {
    "log": "CREATE TABLE log (seq INTEGER PRIMARY KEY, line BLOB NOT NULL, hash TEXT NOT NULL)",
    "file": "CREATE TABLE file (sha256 TEXT PRIMARY KEY, content BLOB NOT NULL) WITHOUT ROWID",
    "cache": "CREATE TABLE cache (key TEXT PRIMARY KEY, seq INTEGER NOT NULL, content BLOB NOT NULL) "
    "WITHOUT ROWID",
    "log_keeps": f"CREATE TRIGGER log_keeps BEFORE UPDATE ON log {_KEPT}",
    "log_stays": f"CREATE TRIGGER log_stays BEFORE DELETE ON log {_KEPT}",
}


def is_sqlite_session(directory: Path) -> bool:
    """Whether a directory holds a session of the former format that was not converted yet.

    Either copy of a log says that it was: steps may have followed that the database does not know.
    """
    return (directory / FILE_NAME).is_file() and not any(path.exists() for path in log_paths(directory))


def finish_conversion(directory: Path) -> None:
    """Put the database aside that a program which was killed while it converted has left in its place."""
    for end in _SIDE_FILES:
        path, aside = directory / f"{FILE_NAME}{end}", directory / f"{FILE_NAME}{end}.converted"
        if path.is_file() and not aside.exists():
            path.rename(aside)


def converted(directory: Path, clock: Callable[[], datetime], *, in_place: bool) -> Path:
    """Convert a session; where it lies now.

    Args:
        directory: of the session.
        clock: gives the time of the entry that says so.
        in_place: write into the directory; otherwise into a temporary one, for reading alone.

    Raises:
        SessionError: no database of such a session.
        AuditError: its log is damaged, or entries may have been lost with a damaged write-ahead log.
    """
    if not is_sqlite_session(directory):
        return directory  # another process was faster
    with tempfile.TemporaryDirectory() as folder:
        entries, files, cached = _read(_copied(directory, Path(folder)), directory / FILE_NAME)
    if not entries:
        raise SessionError(f"{directory}: making this session was interrupted; make it again with `new`")
    last = entries[-1]
    time = clock().astimezone(UTC).isoformat(timespec="milliseconds")
    facts = {"entries": len(entries), "version": version("hdsafebo")}
    entries.append(seal(last.seq + 1, time, "hdsafebo", "converted", facts, last.hash))
    root = directory if in_place else Path(tempfile.mkdtemp())
    if not in_place:
        atexit.register(shutil.rmtree, root, ignore_errors=True)
    if cached is not None and cached[0] <= len(entries):
        Cache(root).write(entries[cached[0] - 1], cached[1], cached[2])
    write_session(root, entries, files.values())
    if in_place:
        finish_conversion(directory)
    return root


def _copied(directory: Path, folder: Path) -> Path:
    """A copy of the database: SQLite writes even where it only reads."""
    for end in _SIDE_FILES[:2]:
        source = directory / f"{FILE_NAME}{end}"
        if source.is_file():
            if source.stat().st_size > MAX_BYTES:
                raise SessionError(f"{source}: {source.stat().st_size} bytes, expected at most {MAX_BYTES}")
            shutil.copyfile(source, folder / source.name)
    return folder / FILE_NAME


def _read(path: Path, source: Path) -> tuple[list[Entry], dict[str, bytes], tuple[int, bytes, bytes] | None]:
    """Entries, files by digest, and the cached states with the number of the last entry they know."""
    lost = _frames_after_damage(path.with_name(f"{FILE_NAME}-wal"))
    if lost:
        raise AuditError(
            f"{source}-wal: damaged: {lost} frames cannot be read, and the steps in them may be lost. "
            f"Restore {source.name} and {source.name}-wal from a backup. To go on with the steps before the "
            f"damage, keep copies of both and run: sqlite3 {source.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
        )
    try:
        database = sqlite3.connect(path)
        try:
            _check_schema(database, source)
            entries = _entries(database, source)
            files = {digest: _file(database, digest, source) for digest in referenced(entries)}
            cached = _cached(database)
            found = database.execute("PRAGMA integrity_check").fetchone()[0]
        finally:
            database.close()
    except sqlite3.Error as error:
        raise AuditError(f"{source}: damaged: {error}") from None
    if found != "ok":
        raise AuditError(f"{source}: damaged: {found}")
    return entries, files, cached


def _check_schema(database: sqlite3.Connection, source: Path) -> None:
    """SessionError unless the tables are those of a session: a view in their place would be a program."""
    application = database.execute("PRAGMA application_id").fetchone()[0]
    version = database.execute("PRAGMA user_version").fetchone()[0]
    made = database.execute("SELECT name, sql FROM sqlite_master LIMIT 20").fetchall()
    if (
        application != _APPLICATION
        or version != _VERSION
        or dict(made) != _SCHEMA
        or len(made) != len(_SCHEMA)
    ):
        raise SessionError(f"{source}: no session of the former format")


def _entries(database: sqlite3.Connection, source: Path) -> list[Entry]:
    entries: list[Entry] = []
    for number, (seq, line, stored) in enumerate(
        database.execute("SELECT seq, line, hash FROM log ORDER BY seq"), start=1
    ):
        where = f"{source}: entry {number}"
        if seq != number or not isinstance(line, bytes) or not isinstance(stored, str):
            raise AuditError(f"{where} is missing or damaged")
        row = stored.encode("utf-8", "replace") + b" " + line
        entries.append(follow_on(read_row(row, where), entries[-1] if entries else None, where))
    return entries


def _file(database: sqlite3.Connection, digest: str, source: Path) -> bytes:
    row = database.execute("SELECT content FROM file WHERE sha256 = ?", (digest,)).fetchone()
    if row is None or not isinstance(row[0], bytes) or _digest(row[0]) != digest:
        raise AuditError(f"{source}: file {digest[:12]}... is missing or was changed")
    return row[0]


def _cached(database: sqlite3.Connection) -> tuple[int, bytes, bytes] | None:
    found = [
        database.execute("SELECT seq, content FROM cache WHERE key = ?", (key,)).fetchone() for key in _CACHED
    ]
    if any(row is None or not isinstance(row[1], bytes) for row in found) or found[0][0] != found[1][0]:
        return None
    contents = [row[1][_SIGNATURE_BYTES:] for row in found]
    if any(bytes.fromhex(_digest(c)) + c != row[1] for c, row in zip(contents, found, strict=True)):
        return None
    return int(found[0][0]), contents[0], contents[1]


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _frames_after_damage(wal: Path) -> int:
    """Frames of a write-ahead log that SQLite would drop in silence though they belong to its last run.

    The format is that of https://www.sqlite.org/fileformat2.html#the_write_ahead_log: a header of 32 bytes,
    then frames of 24 bytes and a page, each with the salts of the header and a checksum over all before it. A
    frame with the header's salts and a wrong checksum, and all behind it, cannot be told from an
    acknowledged step that was damaged.
    """
    content = read_bytes(wal) if wal.exists() else b""
    if not content.strip(b"\0"):
        return 0
    if len(content) < 32:
        return 1
    magic, _, page, _, *_ = struct.unpack(">8I", content[:32])
    order = ">" if magic & 1 else "<"
    size = 24 + (65536 if page == 1 else page)
    salts = content[16:24]
    state = _checksum(content[:24], (0, 0), order)
    if magic not in (0x377F0682, 0x377F0683) or state != struct.unpack(">2I", content[24:32]) or size <= 24:
        return max(1, len(content) // 4096)
    frames = [content[i : i + size] for i in range(32, len(content), size)]
    for number, frame in enumerate(frames):
        if len(frame) < size:
            return 0 if frame[8:16] != salts[: len(frame[8:16])] or len(frame) < 16 else 1
        state = _checksum(frame[:8] + frame[24:], state, order)
        if frame[8:16] != salts or state != struct.unpack(">2I", frame[16:24]):
            return sum(f[8:16] == salts for f in frames[number:]) or int(_half_salted(frame, salts))
    return 0


def _half_salted(frame: bytes, salts: bytes) -> bool:
    """Whether all but one byte of the salts are there: a damaged frame rather than one of an earlier run."""
    return sum(a == b for a, b in zip(frame[8:16], salts, strict=True)) >= 7


def _checksum(data: bytes, start: tuple[int, int], order: str) -> tuple[int, int]:
    first, second = start
    words = struct.unpack(f"{order}{len(data) // 4}I", data)
    for a, b in zip(words[::2], words[1::2], strict=True):
        first = (first + a + second) & 0xFFFFFFFF
        second = (second + b + first) & 0xFFFFFFFF
    return first, second
