"""One session's durable store: an SQLite file in WAL mode that syncs to disk at every commit.

The log is the truth: the state of a session is what its entries say, in order. Files that were handed in
(recordings, an embedding) lie beside it under their SHA-256. `cache` holds what can be computed again.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hdsafebo.session.errors import AuditError, ProtocolError, SessionError
from hdsafebo.session.log.chain import START, Entry, check_chain, seal

FILE_NAME = "session.db"
_APPLICATION = 0x48445342  # marks the file as ours in SQLite's header
_VERSION = 1
_BUSY_S = 30.0
_DIGEST = hashlib.sha256().digest_size
_SCHEMA = """
CREATE TABLE log (seq INTEGER PRIMARY KEY, line BLOB NOT NULL, hash TEXT NOT NULL);
CREATE TABLE file (sha256 TEXT PRIMARY KEY, content BLOB NOT NULL) WITHOUT ROWID;
CREATE TABLE cache (key TEXT PRIMARY KEY, seq INTEGER NOT NULL, content BLOB NOT NULL) WITHOUT ROWID;
CREATE TRIGGER log_keeps BEFORE UPDATE ON log BEGIN SELECT RAISE(ABORT, 'the log is append-only'); END;
CREATE TRIGGER log_stays BEFORE DELETE ON log BEGIN SELECT RAISE(ABORT, 'the log is append-only'); END;
"""

Clock = Callable[[], datetime]
Act = tuple[str, dict[str, Any]]
"""Kind and payload of an entry to append."""


class MovedOnError(ProtocolError):
    """Someone else appended to the log meanwhile."""


def utc_now() -> datetime:
    """The wall clock."""
    return datetime.now(UTC)


class Store:
    """The store of one session.

    Args:
        directory: of the session.
        clock: gives the time of entries.
    """

    def __init__(self, directory: Path, clock: Clock = utc_now) -> None:
        self.path = directory / FILE_NAME
        self._clock = clock
        if not self.path.is_file():
            raise SessionError(f"{directory}: no session here ({FILE_NAME} is missing)")
        with self._guard():
            self._db = _connect(self.path)
            application = self._db.execute("PRAGMA application_id").fetchone()[0]
            version = self._db.execute("PRAGMA user_version").fetchone()[0]
        if application != _APPLICATION or version != _VERSION:
            self._db.close()
            raise SessionError(f"{self.path}: no session store of this version")

    @classmethod
    def create(cls, directory: Path, clock: Clock = utc_now) -> Store:
        """A new store, or one whose making was interrupted; SessionError when there is a session already."""
        path = directory / FILE_NAME
        try:
            directory.mkdir(parents=True, exist_ok=True)
            database = _connect(path)
            if not database.execute("SELECT 1 FROM sqlite_master").fetchone():
                header = f"PRAGMA application_id = {_APPLICATION}; PRAGMA user_version = {_VERSION};"
                database.executescript(f"BEGIN IMMEDIATE; {header} {_SCHEMA} COMMIT;")
            database.close()
        except (OSError, sqlite3.Error) as error:
            raise SessionError(f"{path}: cannot be made: {_explained(error)}") from None
        store = cls(directory, clock)
        if store.lines():
            store.close()
            raise SessionError(f"{directory}: already holds a session")
        return store

    def close(self) -> None:
        """Close the database."""
        self._db.close()

    def lines(self, after: int = 0) -> list[tuple[bytes, str]]:
        """(line, hash) of the entries behind number `after`, as stored and unchecked."""
        with self._guard():
            rows = self._db.execute(
                "SELECT seq, line, hash FROM log WHERE seq > ? ORDER BY seq", (after,)
            ).fetchall()
        for expected, (seq, line, stored) in enumerate(rows, start=after + 1):
            if seq != expected or not isinstance(line, bytes) or not isinstance(stored, str):
                raise AuditError(f"{self.path}: entry {expected} is missing or damaged")
        return [(line, stored) for _, line, stored in rows]

    def entries(self, after: Entry | None = None) -> list[Entry]:
        """Checked entries behind `after`; AuditError when the chain is broken."""
        return check_chain(self.lines(after.seq if after else 0), after=after, source=str(self.path))

    def append(
        self,
        head: Entry | None,
        who: str,
        acts: Sequence[Act],
        files: Sequence[bytes] = (),
        cache: Sequence[tuple[str, bytes]] = (),
    ) -> list[Entry]:
        """Append entries in one transaction; when this returns they are on the disk.

        Args:
            head: the last entry that the caller knows.
            who: the acting person.
            acts: what happened.
            files: contents that the entries refer to by their SHA-256.
            cache: (key, content) pairs replaced in the same transaction.

        Raises:
            MovedOnError: `head` is not the last entry any more; nothing was appended.
            SessionError: the disk is full or cannot be written; nothing was appended.
        """
        new: list[Entry] = []
        with self._guard(), self._transaction():
            row = self._db.execute("SELECT seq, hash FROM log ORDER BY seq DESC LIMIT 1").fetchone()
            known = (head.seq, head.hash) if head else None
            if row != known:
                raise MovedOnError("the session has moved on meanwhile: look at its status and decide again")
            seq, previous = known or (0, START)
            for content in files:
                digest = hashlib.sha256(content).hexdigest()
                self._db.execute("INSERT OR IGNORE INTO file VALUES (?, ?)", (digest, content))
            for kind, payload in acts:
                seq += 1
                time = self._clock().astimezone(UTC).isoformat(timespec="milliseconds")
                line, entry = seal(seq, time, who, kind, payload, previous)
                self._db.execute("INSERT INTO log VALUES (?, ?, ?)", (seq, line, entry.hash))
                new.append(entry)
                previous = entry.hash
            for key, content in cache:
                self._db.execute(
                    "INSERT OR REPLACE INTO cache VALUES (?, ?, ?)", (key, seq, _signed(content))
                )
        return new

    def file(self, sha256: str) -> bytes:
        """Content of a stored file; AuditError when it is missing or was changed."""
        with self._guard():
            row = self._db.execute("SELECT content FROM file WHERE sha256 = ?", (sha256,)).fetchone()
        if row is None or not isinstance(row[0], bytes) or hashlib.sha256(row[0]).hexdigest() != sha256:
            raise AuditError(f"{self.path}: file {sha256[:12]}... is missing or was changed")
        return row[0]

    def check_integrity(self) -> None:
        """SQLite's own check of the file's structure; AuditError when it finds damage."""
        with self._guard():
            found = self._db.execute("PRAGMA integrity_check").fetchone()[0]
        if found != "ok":
            raise AuditError(f"{self.path}: damaged: {found}")

    def cached(self, key: str) -> tuple[int, bytes] | None:
        """(number of the last entry it knows, content) of a cached value; None when missing or damaged."""
        with self._guard():
            row = self._db.execute("SELECT seq, content FROM cache WHERE key = ?", (key,)).fetchone()
        if row is None or not isinstance(row[0], int) or not isinstance(row[1], bytes):
            return None
        content = row[1][_DIGEST:]
        return (row[0], content) if _signed(content) == row[1] else None

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._db.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._db.execute("COMMIT")
        except BaseException:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")
            raise

    @contextmanager
    def _guard(self) -> Iterator[None]:
        """Turn SQLite's errors into ours."""
        try:
            yield
        except sqlite3.DatabaseError as error:
            if isinstance(error, sqlite3.OperationalError):
                raise SessionError(f"{self.path}: {_explained(error)}; nothing was recorded") from None
            raise AuditError(f"{self.path}: damaged: {error}") from None


def _explained(error: Exception) -> str:
    """SQLite's words, which for a disk without room may be "disk I/O error" or "unable to open"."""
    name = getattr(error, "sqlite_errorname", "")
    of_the_disk = name.startswith(("SQLITE_IOERR", "SQLITE_CANTOPEN", "SQLITE_READONLY"))
    return f"{error} (is the disk full or read-only?)" if of_the_disk else str(error)


def _signed(content: bytes) -> bytes:
    """Content behind its SHA-256, so that damage is noticed."""
    return hashlib.sha256(content).digest() + content


def _connect(path: Path) -> sqlite3.Connection:
    database = sqlite3.connect(path, timeout=_BUSY_S, isolation_level=None, check_same_thread=False)
    database.execute("PRAGMA trusted_schema = OFF")
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA synchronous = FULL")
    return database
