"""Sessions of the former format, one SQLite file: read once, checked, and written in the present format.

What was `session.db` is kept as `session.db.converted`. Nothing of the database is trusted: its header must
be that of a session, and it no longer than that says; its tables must be exactly those that sessions had;
every entry proves itself by its hash; the write-ahead log, whose damaged end SQLite drops in silence, is
checked frame by frame; and no more is in memory at a time than of a session of the present format.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import sqlite3
import struct
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import BinaryIO

from hdsafebo.files.bounded import open_regular
from hdsafebo.files.sparse import copy_sparse, pieces_of_data
from hdsafebo.session.errors import AuditError, SessionError
from hdsafebo.session.log.attachments import MAX_BYTES as MAX_FILE_BYTES
from hdsafebo.session.log.cache import MAX_BYTES as MAX_CACHE_BYTES
from hdsafebo.session.log.cache import Cache
from hdsafebo.session.log.chain import (
    MAX_ENTRY_BYTES,
    MAX_LOG_BYTES,
    Entry,
    follow_on,
    read_row,
    seal,
)
from hdsafebo.session.log.layout import log_paths, referenced, write_session

FILE_NAME = "session.db"
MAX_BYTES = 8 * 2**30
MAX_WAL_BYTES = 2 * 2**30  # it grew to the largest step, which kept an embedding of up to 2**30 bytes
_SIDE_FILES = ("", "-wal", "-shm")
_MAGIC = b"SQLite format 3\0"
_HEADER_BYTES = 100
_WAL_HEADER_BYTES, _FRAME_HEADER_BYTES = 32, 24
_WAL_MAGIC = (0x377F0682, 0x377F0683)
_PAGE_SIZES = tuple(2**k for k in range(9, 17))
_FRACTIONS = bytes([64, 32, 32])  # SQLite knows no others
_IN_WAL_MODE = bytes([2, 2])
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
    root = directory if in_place else Path(tempfile.mkdtemp())
    if not in_place:
        atexit.register(shutil.rmtree, root, ignore_errors=True)
    # SQLite looks for a write-ahead log beside the file itself, not beside a link to it.
    path = (directory / FILE_NAME).resolve()
    with _opened(path) as database:
        entries = _entries(database, path)
        if not entries:
            raise SessionError(f"{directory}: making this session was interrupted; make it again with `new`")
        digests = referenced(entries)
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_FILE_BYTES)
        for digest in digests:
            _file(database, digest, path)
        _check_structure(database, path)
        last = entries[-1]
        time = clock().astimezone(UTC).isoformat(timespec="milliseconds")
        facts = {"entries": len(entries), "version": version("hdsafebo")}
        entries.append(seal(last.seq + 1, time, "hdsafebo", "converted", facts, last.hash))
        cached = _cached(database)
        if cached is not None and 0 < cached[0] <= len(entries):
            Cache(root).write(entries[cached[0] - 1], cached[1], cached[2])
        write_session(root, entries, (_file(database, digest, path) for digest in digests))
    if in_place:
        finish_conversion(directory)
    return root


@contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    """The database of a session, of which header, size, write-ahead log and tables are right.

    Raises:
        SessionError: it is none.
        AuditError: it is damaged, which may show while it is being read.
    """
    wal = path.with_name(f"{path.name}-wal")
    if os.path.lexists(wal) and not wal.is_file():
        raise SessionError(f"{wal}: is no regular file")
    followed = wal.is_file() and _is_written(wal)
    _check_header(path, wal if followed else None)
    lost = _frames_after_damage(wal) if followed else 0
    if lost:
        raise AuditError(
            f"{wal}: damaged: {lost} frames cannot be read, and the steps in them may be lost. "
            f"Restore {path.name} and {wal.name} from a backup. To go on with the steps before the "
            f"damage, keep copies of both and run: sqlite3 {path.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
        )
    try:
        with (
            tempfile.TemporaryDirectory() as folder,
            closing(_connected(path, wal if followed else None, Path(folder))) as database,
        ):
            _check_schema(database, path)
            yield database
    except sqlite3.Error as error:
        raise AuditError(f"{path}: damaged: {error}") from None


def _check_header(path: Path, wal: Path | None) -> None:
    """SessionError unless the database's first bytes are a session's, and it no longer than they say.

    Who made a session closed its database, empty yet, so that the file itself has said since what it is; the
    write-ahead log need not be asked. A program that was killed while it took pages over from that log may
    have left more of them than the header counts, but no more than the log holds.

    Args:
        path: of the database.
        wal: its write-ahead log; None without one.
    """
    with open_regular(path) as file:
        header, size = file.read(_HEADER_BYTES), os.fstat(file.fileno()).st_size
    page = _page_bytes(header[16:18])
    good = (
        len(header) == _HEADER_BYTES
        and header.startswith(_MAGIC)
        and page in _PAGE_SIZES
        and header[21:24] == _FRACTIONS
        and (wal is None or header[18:20] == _IN_WAL_MODE)
        and int.from_bytes(header[60:64]) == _VERSION
        and int.from_bytes(header[68:72]) == _APPLICATION
    )
    if not good:
        raise SessionError(f"{path}: no session of the former format")
    wal_bytes = wal.stat().st_size if wal else 0
    most = min(page * int.from_bytes(header[28:32]) + wal_bytes, MAX_BYTES)
    if size > most:
        raise SessionError(f"{path}: {size} bytes, expected at most {most}")


def _page_bytes(stored: bytes) -> int:
    """Size of a page as headers have it: 65,536, which does not fit into two bytes, stands there as 1."""
    return 65536 if int.from_bytes(stored) == 1 else int.from_bytes(stored)


def _connected(path: Path, wal: Path | None, folder: Path) -> sqlite3.Connection:
    """The database, open for reading; copied where it has a write-ahead log, which SQLite reads by writing.

    The copy takes no more of the disk than the files do, whatever their sizes say.

    Args:
        path: of the database.
        wal: its write-ahead log; None without one.
        folder: for the copy.
    """
    if wal is None:
        return sqlite3.connect(f"{path.resolve().as_uri()}?immutable=1", uri=True)
    copy_sparse(path, folder / path.name, MAX_BYTES)
    copy_sparse(wal, folder / wal.name, MAX_WAL_BYTES)
    return sqlite3.connect(folder / path.name)


def _check_schema(database: sqlite3.Connection, source: Path) -> None:
    """SessionError unless the tables are those of a session: a view in their place would be a program."""
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, 2 * MAX_ENTRY_BYTES)  # of any row, its other columns too
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


def _check_structure(database: sqlite3.Connection, source: Path) -> None:
    """AuditError where SQLite finds damage."""
    found = database.execute("PRAGMA integrity_check").fetchone()[0]
    if found != "ok":
        raise AuditError(f"{source}: damaged: {found}")


def _entries(database: sqlite3.Connection, source: Path) -> list[Entry]:
    """All entries; no more than a log of the present format takes."""
    entries: list[Entry] = []
    size = 0
    for number, (seq, line, stored) in enumerate(
        database.execute("SELECT seq, line, hash FROM log ORDER BY seq"), start=1
    ):
        where = f"{source}: entry {number}"
        if seq != number or not isinstance(line, bytes) or not isinstance(stored, str):
            raise AuditError(f"{where} is missing or damaged")
        row = stored.encode("utf-8", "replace") + b" " + line
        entries.append(follow_on(read_row(row, where), entries[-1] if entries else None, where))
        size += len(row) + 1  # and its line break
        if size > MAX_LOG_BYTES:
            raise SessionError(f"{where}: more than {MAX_LOG_BYTES} bytes of entries")
    return entries


def _file(database: sqlite3.Connection, digest: str, source: Path) -> bytes:
    """Content of one file that an entry refers to."""
    row = database.execute("SELECT content FROM file WHERE sha256 = ?", (digest,)).fetchone()
    if row is None or not isinstance(row[0], bytes) or _digest(row[0]) != digest:
        raise AuditError(f"{source}: file {digest[:12]}... is missing or was changed")
    return row[0]


def _cached(database: sqlite3.Connection) -> tuple[int, bytes, bytes] | None:
    """The cached states with the number of the last entry they know; None when missing, damaged or huge."""
    size = database.execute("SELECT SUM(LENGTH(content)) FROM cache").fetchone()[0]
    if size is None or size > MAX_CACHE_BYTES:
        return None
    found = [
        database.execute("SELECT seq, content FROM cache WHERE key = ?", (key,)).fetchone() for key in _CACHED
    ]
    if any(row is None or not isinstance(row[1], bytes) for row in found) or found[0][0] != found[1][0]:
        return None
    contents = [row[1][_SIGNATURE_BYTES:] for row in found]
    if any(bytes.fromhex(_digest(c)) + c != row[1] for c, row in zip(contents, found, strict=True)):
        return None
    known = found[0][0]
    return (known, contents[0], contents[1]) if isinstance(known, int) else None


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _is_written(wal: Path) -> bool:
    """Whether a write-ahead log holds anything but zeros; SessionError when it is larger than any was."""
    with open_regular(wal) as file:
        size = os.fstat(file.fileno()).st_size
        if size > MAX_WAL_BYTES:
            raise SessionError(f"{wal}: {size} bytes, expected at most {MAX_WAL_BYTES}")
        return any(piece.strip(b"\0") for _, piece in pieces_of_data(file, size))


def _pieces(file: BinaryIO, size: int) -> Iterator[bytes]:
    """The rest of a file in pieces of a size; the last one may be shorter."""
    while piece := file.read(size):
        yield piece


def _frames_after_damage(wal: Path) -> int:
    """Frames of a write-ahead log that SQLite would drop in silence though they belong to its last run.

    The format is that of https://www.sqlite.org/fileformat2.html#the_write_ahead_log: a header of 32 bytes,
    then frames of 24 bytes and a page, each with the salts of the header and a checksum over all before it. A
    frame with the header's salts and a wrong checksum, and all behind it, cannot be told from an
    acknowledged step that was damaged.
    """
    with open_regular(wal) as file:
        header = file.read(_WAL_HEADER_BYTES)
        if len(header) < _WAL_HEADER_BYTES:
            return 1
        magic, page, salts = int.from_bytes(header[:4]), _page_bytes(header[8:12]), header[16:24]
        order = ">" if magic & 1 else "<"
        state = _checksum(header[:24], (0, 0), order)
        if magic not in _WAL_MAGIC or page not in _PAGE_SIZES or state != struct.unpack(">2I", header[24:]):
            return max(1, os.fstat(file.fileno()).st_size // 4096)
        size = _FRAME_HEADER_BYTES + page
        frames = _pieces(file, size)
        for frame in frames:
            if len(frame) < size:
                return 0 if frame[8:16] != salts[: len(frame[8:16])] or len(frame) < 16 else 1
            state = _checksum(frame[:8] + frame[_FRAME_HEADER_BYTES:], state, order)
            if frame[8:16] != salts or state != struct.unpack(">2I", frame[16:24]):
                own = (frame[8:16] == salts) + sum(f[8:16] == salts for f in frames)
                return own or int(_half_salted(frame, salts))
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
