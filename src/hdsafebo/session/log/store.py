"""One session's durable store: an append-only text log in two copies, synced to the disk at every step.

    original/audit.log, copy/audit.log      the log (see `chain`); an entry is acknowledged when it is in both
    original/files/, copy/files/            files that entries refer to by their SHA-256
    cache/                                  what can be computed again
    STOP-...                                stops that wait for their place in the log (see `stops`)
    lock                                    held while someone appends

The log is the truth: the state of a session is what its entries say, in order. Plain files were preferred to
SQLite, which has no checksums of its pages and takes a damaged end of its write-ahead log for steps that were
never acknowledged. Files are opened anew for every step, so one that was deleted or replaced is noticed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hdsafebo.files.atomic import WriteError, sync_directory
from hdsafebo.files.durable import locked, make_durable_directory
from hdsafebo.session.errors import AuditError, ProtocolError, SessionError
from hdsafebo.session.log.chain import (
    MAX_ENTRY_BYTES,
    MAX_LOG_BYTES,
    START,
    Entry,
    follow_on,
    read_row,
    row_of,
    rows,
    seal,
    write_rows,
)
from hdsafebo.session.log.copies import Reading, read_copies
from hdsafebo.session.log.layout import (
    LOCK,
    append_to_all,
    attachments_of,
    log_paths,
    referenced,
    replace_log,
    write_session,
)
from hdsafebo.session.log.sqlite_format import converted, finish_conversion, is_sqlite_session
from hdsafebo.session.log.stops import Stop, pending

PROGRAM = "hdsafebo"
STARTING = ("suggested", "approved", "modified", "manual", "resumed")  # no trial may start past a stop
_BUSY_S = 30.0
_BRIEFLY_S = 0.05

Clock = Callable[[], datetime]


class MovedOnError(ProtocolError):
    """Someone else appended to the log meanwhile."""


def utc_now() -> datetime:
    """The wall clock."""
    return datetime.now(UTC)


class Store:
    """The store of one session; reads on from where it was, and appends.

    Args:
        directory: of the session.
        clock: gives the time of entries.
        read_only: write nothing, not even to mend what is damaged.

    Attributes:
        root: where the files lie: the directory, or a converted copy when a session of the former SQLite
            format lies in a directory that cannot be written.
        attachments: files that entries refer to.
        notices: what was found damaged, in words.

    Raises:
        SessionError: there is no session.
        AuditError: its log is damaged beyond what the two copies make good.
    """

    def __init__(self, directory: Path, clock: Clock = utc_now, *, read_only: bool = False) -> None:
        former = is_sqlite_session(directory)
        if not former and not any(path.exists() for path in log_paths(directory)):
            raise SessionError(f"{directory}: no session here ({log_paths(Path())[0]} is missing)")
        self.directory = self.root = directory
        self.notices: list[str] = []
        self.writable = not read_only and _writable(directory)
        self._clock, self._read_only = clock, read_only
        self._head: Entry | None = None
        self._end = 0  # bytes of the original up to the head
        self._unread: list[Entry] = []
        self._pressed: set[str] = set()  # tokens of the stops that are in the log
        self._mended: list[str] = []  # damage that is mended and not yet in the log
        with self._explained("read"):
            if former:
                with self._exclusive(_BUSY_S) if self.writable else nullcontext():
                    self.root = converted(directory, clock, in_place=self.writable)
            elif self.writable:
                finish_conversion(directory)
            self._logs = log_paths(self.root)
            self.attachments = attachments_of(self.root)
            self._reload()

    def opened_anew(self) -> Store:
        """The same session, of which nothing has been read yet.

        Raises:
            SessionError: both copies of its log are gone.
        """
        if not any(path.exists() for path in log_paths(self.directory)) and self.root == self.directory:
            raise SessionError(
                f"{self.directory}: the log was deleted or moved under the open session, and is "
                "not there any more; nothing was recorded"
            )
        anew = Store(self.directory, self._clock, read_only=self._read_only)
        anew.notices = list(dict.fromkeys([*self.notices, *anew.notices]))
        return anew

    @classmethod
    def create(cls, directory: Path, clock: Clock = utc_now) -> Store:
        """A new store, or one whose making was interrupted; SessionError when there is a session already."""
        if is_sqlite_session(directory):
            raise SessionError(f"{directory}: already holds a session")
        try:
            for path in log_paths(directory):
                make_durable_directory(path.parent)
                with path.open("ab"):
                    pass
                sync_directory(path.parent)
        except OSError as error:
            raise SessionError(f"{directory}: cannot be made: {_explained(error)}") from None
        store = cls(directory, clock)
        if store.read():
            raise SessionError(f"{directory}: already holds a session")
        return store

    def read(self) -> list[Entry]:
        """Entries that were appended, by whomever, since this was called last.

        Raises:
            AuditError: the log is damaged beyond what the two copies make good, cut or replaced.
            SessionError: both copies of the log are gone.
        """
        with self._explained("read"):
            if not self._read_on(final=False):
                self._reload()
        entries, self._unread = self._unread, []
        return entries

    def entries(self) -> list[Entry]:
        """The whole log, read anew from both copies.

        Raises:
            AuditError: either copy is damaged; when nothing is lost the message says so.
        """
        with self._explained("read"):
            reading = self._steady()
        if reading.damage:
            raise AuditError(
                f"{'; '.join(reading.damage)}. Nothing is lost: the other copy holds all "
                f"{len(reading.entries)} entries. Keep a copy of the directory, then mend it with "
                "`hdsafebo session repair`"
            )
        return reading.entries

    def append(
        self, head: Entry | None, who: str, kind: str, payload: dict[str, Any], files: Sequence[bytes] = ()
    ) -> None:
        """Append an entry; when this returns it is on the disk, in both copies, and `read` returns it.

        Args:
            head: the last entry that the caller knows.
            who: the acting person.
            kind: what happened.
            payload: the facts.
            files: contents that the entry refers to by their SHA-256.

        Raises:
            MovedOnError: `head` is not the last entry any more, or a stop waits for its place in the log;
                nothing was appended.
            SessionError: the log is gone, locked by another program for long, or the disk is full or cannot
                be written; nothing was appended.
        """
        with self._explained("written"), self._exclusive(_BUSY_S):
            self._settle()
            if self._head != head:
                raise MovedOnError("the session has moved on meanwhile: look at its status and decide again")
            if kind in STARTING and pending(self.directory):
                raise MovedOnError("the session was stopped meanwhile")
            for content in files:
                self.attachments.add(content)
            self._write(who, kind, payload)
            self._log_mended()

    def adopt_stops(self, wait_s: float = _BRIEFLY_S) -> list[Stop]:
        """Write waiting stops into the log and remove their files; returns those that still wait.

        Args:
            wait_s: for how long to try to get the lock.
        """
        if not pending(self.directory) or not self.writable:
            return pending(self.directory)
        with suppress(SessionError), self._explained("written"), self._exclusive(wait_s):
            self._settle()
            for stop in pending(self.directory):
                if stop.token in self._pressed:  # a writer was killed before it removed the file
                    stop.path.unlink()
                    continue
                if not stop.complete:
                    continue
                facts = {"reason": stop.reason, "pressed": stop.token, "at": stop.time}
                self._write(stop.who, "stopped", facts)
                stop.path.unlink()
            self._log_mended()
        return pending(self.directory)

    def repair(self) -> list[str]:
        """Mend both copies of the log and of all files; what was wrong, in words.

        Raises:
            AuditError: something is whole in neither copy.
            SessionError: the directory cannot be written.
        """
        with self._explained("written"), self._exclusive(_BUSY_S):
            self._mend()
            found = self.attachments.mend(referenced(read_copies(self._logs).entries))
            self._mended += found
            found = list(self._mended)
            self._log_mended()
        return found

    def back_up(self, target: Path) -> Entry:
        """Write all that is acknowledged now, and stops that wait, into a new directory; its last entry.

        Raises:
            SessionError: the target exists or cannot be written.
            AuditError: something is whole in neither copy.
        """
        if target.exists():
            raise SessionError(f"{target}: exists already; name a directory that does not")
        stops = pending(self.directory)  # first: one that comes into the log meanwhile is in both
        with self._explained("read"):
            entries = self._steady().entries
        write_session(target, entries, (self.attachments.content(d) for d in referenced(entries)), stops)
        return Store(target, self._clock, read_only=True).entries()[-1]

    # --- reading

    def _read_on(self, *, final: bool) -> bool:
        """Read on to the end of the original; False when something does not fit.

        Args:
            final: nobody is writing, so the original ends with a whole row and the copy is as long.
        """
        try:
            for row in rows(self._logs[0], self._end):
                if not row.endswith(b"\n"):
                    break
                source = f"{self._logs[0]}, byte {self._end}"
                self._accept(follow_on(read_row(row[:-1], source), self._head, source), len(row))
            sizes = [path.stat().st_size for path in self._logs]
        except (AuditError, OSError):
            return False
        return sizes == [self._end] * 2 if final else sizes[0] >= self._end

    def _steady(self) -> Reading:
        """Both copies, read while nobody writes if that can be had: a writer at work looks like damage."""
        reading = read_copies(self._logs)
        if reading.damage:
            with suppress(SessionError, OSError), self._exclusive(_BUSY_S, shared=True):
                return read_copies(self._logs)
        return reading

    def _reload(self) -> None:
        """Take in both copies anew, and mend what is damaged if that can be done at once."""
        reading = self._steady()
        if reading.damage and self.writable:
            with suppress(SessionError, OSError), self._exclusive(_BRIEFLY_S):
                self._mend()
                self._log_mended()
                return
        self.notices += [text for text in reading.damage if text not in self.notices]
        self._accept_all(reading)

    def _accept(self, entry: Entry, length: int) -> None:
        self._end += length
        self._notice([entry])

    def _notice(self, entries: list[Entry]) -> None:
        """New entries are there."""
        self._unread += entries
        self._head = entries[-1] if entries else self._head
        self._pressed |= {e.payload.get("pressed", "") for e in entries if e.kind == "stopped"}

    def _accept_all(self, reading: Reading) -> None:
        """Take in a whole log; AuditError when it is not the one that was read before, or longer."""
        known = self._head.seq if self._head else 0
        if self._head is not None and reading.entries[known - 1 : known] != [self._head]:
            raise AuditError(
                f"{self.directory}: the log is gone, cut or replaced: entry {known}, which was read before, "
                "is not there any more; nothing was recorded"
            )
        self._notice(reading.entries[known:])
        self._end = len(write_rows(reading.entries))

    # --- writing; all of it needs the lock

    def _settle(self) -> None:
        """Read on, and put in order what a killed writer has left behind or somebody has damaged."""
        if not self._read_on(final=True):
            self._mend()

    def _mend(self) -> None:
        """Bring both copies to what they hold together; damaged ones are kept beside them."""
        reading = read_copies(self._logs)
        self._accept_all(reading)
        if not reading.tidy:
            content = write_rows(reading.entries)
            for path in self._logs:
                replace_log(path, content, keep=any(str(path) in text for text in reading.damage))
        self._mended += reading.damage

    def _log_mended(self) -> None:
        """An entry about what was mended."""
        if self._mended:
            damage, self._mended = self._mended, []
            self.notices += damage
            self._write(PROGRAM, "repaired", {"damage": damage})

    def _write(self, who: str, kind: str, payload: dict[str, Any]) -> None:
        """Append an entry to both copies."""
        seq, previous = (self._head.seq, self._head.hash) if self._head else (0, START)
        time = self._clock().astimezone(UTC).isoformat(timespec="milliseconds")
        entry = seal(seq + 1, time, who, kind, payload, previous)
        row = row_of(entry)
        if len(row) > MAX_ENTRY_BYTES or self._end + len(row) > MAX_LOG_BYTES:
            raise SessionError(
                f"{self._logs[0]}: an entry of {len(row)} bytes, expected at most {MAX_ENTRY_BYTES}, and "
                f"{MAX_LOG_BYTES} for the whole log; nothing was recorded"
            )
        if not append_to_all(self._logs, self._end, row):
            raise MovedOnError("another program wrote into the log at the same time: look at its status")
        self._accept(entry, len(row))

    @contextmanager
    def _exclusive(self, wait_s: float, *, shared: bool = False) -> Iterator[None]:
        """Hold the session's lock; SessionError when it cannot be had in time."""
        if not (self.writable or shared):
            raise SessionError(f"{self.directory}: cannot be written; nothing was recorded")
        flags = os.O_RDONLY if shared else os.O_RDWR | os.O_CREAT
        file = os.open(self.directory / LOCK, flags | os.O_CLOEXEC, 0o644)
        try:
            with locked(file, wait_s, shared=shared):
                yield
        except TimeoutError:
            raise SessionError(
                f"{self.directory}: another program has held the session for {wait_s:g} s; "
                "nothing was recorded"
            ) from None
        finally:
            os.close(file)

    @contextmanager
    def _explained(self, action: str) -> Iterator[None]:
        """Turn errors of the disk into ours."""
        try:
            yield
        except FileNotFoundError as error:
            raise SessionError(
                f"{error.filename}: is gone, deleted or moved under the open session; nothing was recorded"
                if error.filename is not None
                else f"{self.directory}: cannot be {action}: {error.strerror or error}"
            ) from None
        except OSError as error:
            raise SessionError(
                f"{error.filename or self.directory}: cannot be {action}: {_explained(error)}; "
                "nothing was recorded"
            ) from None
        except WriteError as error:
            raise SessionError(f"{error} (is the disk full?); nothing was recorded") from None


def _writable(directory: Path) -> bool:
    """Whether the directory can be written; its lock file is made in passing."""
    try:
        os.close(os.open(directory / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644))
    except OSError:
        return False
    return True


def _explained(error: OSError) -> str:
    return f"{error.strerror or error} (is the disk full or read-only?)"
