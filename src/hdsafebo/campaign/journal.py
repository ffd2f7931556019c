"""A durable log: once `append` returns, the record survives a kill, a crash and a power cut.

Append-only files with fsync were preferred to SQLite in WAL mode for three reasons. A campaign may run
on a cluster, and WAL needs memory shared by all writers, which a network file system does not give. Each
run has a file of its own, so damage stays within one run. And every byte is covered by a chain of
SHA-256 digests: SQLite keeps no checksums of its pages, and takes a damaged end of its WAL for
transactions that were never committed, so that acknowledged trials would vanish in silence.

Format: one line per record, `DIGEST KEY VALUE`, the value JSON without line breaks, and DIGEST the
SHA-256 of the previous digest followed by `KEY VALUE`.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hdsafebo.errors import JournalError
from hdsafebo.files.atomic import sync_directory
from hdsafebo.files.bounded import require_regular
from hdsafebo.files.durable import append_durably, is_in_place, locked, make_durable_directory

_DIGEST_LENGTH = 64
_START = "0" * _DIGEST_LENGTH
_BEGINNING = re.compile(rb"[0-9a-f]{0,63}|[0-9a-f]{64}( [^\n]*)?")


class Journal:
    """An append-only mapping from keys to plain data; several processes may append to one file.

    Args:
        path: the file; it and its parent directories are made when missing.

    Raises:
        JournalError: the file is damaged, or cannot be opened or read. The message says what to do.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.records: dict[str, object] = {}
        self._digests: dict[str, str] = {}  # of the values, to notice conflicts
        self._end = 0  # bytes of the file that are known to be good
        self._digest = _START
        with self._explained("opened"):
            make_durable_directory(path.parent)
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            require_regular(path)
            sync_directory(path.parent)
        try:
            with locked(self._file):
                self._catch_up()
        except BaseException:
            self.close()
            raise

    def append(self, key: str, value: object) -> bool:
        """Make a record durable.

        Args:
            key: name of the record, without white space.
            value: plain data with finite numbers.

        Returns:
            True if the record is new, False if the journal holds the same record.

        Raises:
            JournalError: the key has another value (the first is kept), or the disk is full or cannot
                be written (what was appended before is intact).
        """
        if not key or any(c.isspace() for c in key):
            raise JournalError(f"{self.path}: key {key!r}; expected a name without white space")
        text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
        with self._explained("written"), locked(self._file):
            self._require_in_place()
            self._catch_up()
            if key in self._digests:
                if self._digests[key] != _sha256(text):
                    raise JournalError(
                        f"{self.path}: record {key!r} is already there with another value; the first is kept"
                    )
                return False
            digest = _chain(self._digest, key, text)
            line = f"{digest} {key} {text}\n".encode()
            append_durably(self._file, self._end, line)
            self._accept(key, text, digest, len(line))
        return True

    def refresh(self) -> None:
        """Read what other processes appended."""
        with self._explained("read"), locked(self._file):
            self._catch_up()

    def close(self) -> None:
        """Close the file; the journal cannot be used afterwards."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _require_in_place(self) -> None:
        """JournalError when the file was deleted or replaced: what is appended to it, nobody would read."""
        if not is_in_place(self.path, self._file):
            raise JournalError(
                f"{self.path}: was deleted or replaced while in use; what was acknowledged before is lost "
                "with it, and a run that is started again computes it anew"
            )

    def _catch_up(self) -> None:
        """Read from the last known good byte to the end; needs the lock."""
        size = os.fstat(self._file).st_size
        if size < self._end:
            raise JournalError(f"{self.path}: has shrunk from {self._end} to {size} bytes while in use")
        data = b""
        while len(data) < size - self._end:
            block = os.pread(self._file, size - self._end - len(data), self._end + len(data))
            if not block:
                raise JournalError(f"{self.path}: ends at {self._end + len(data)} of {size} bytes")
            data += block
        *lines, tail = data.split(b"\n")
        for line in lines:
            self._read(line)
        if tail:
            self._drop_torn(tail)

    def _read(self, line: bytes) -> None:
        try:
            digest, key, text = line.decode().split(" ", 2)
            good = digest == _chain(self._digest, key, text) and key not in self._digests
        except ValueError:  # not UTF-8, or too few parts
            good = False
        if not good:
            raise self._damaged()
        self._accept(key, text, digest, len(line) + 1)

    def _drop_torn(self, tail: bytes) -> None:
        """Remove a line that a killed process left incomplete: it was never acknowledged.

        What cannot be the beginning of a record is damage, or another file, and so is a whole record with
        a wrong last byte. A power cut may leave zeros in the place of what was not written yet.
        """
        if not _BEGINNING.fullmatch(tail.rstrip(b"\0")):
            raise self._damaged()
        with suppress(ValueError):
            digest, key, text = tail[:-1].decode().split(" ", 2)
            if digest == _chain(self._digest, key, text):
                self._read(tail)
        os.ftruncate(self._file, self._end)
        os.fsync(self._file)

    def _damaged(self) -> JournalError:
        return JournalError(
            f"{self.path}: damaged after {len(self._digests)} good records (byte {self._end}); "
            f"restore the file from a copy, or remove {self.path.parent} to compute the run again"
        )

    def _accept(self, key: str, text: str, digest: str, length: int) -> None:
        self._digests[key] = _sha256(text)
        self.records[key] = json.loads(text)
        self._digest = digest
        self._end += length

    @contextmanager
    def _explained(self, action: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise JournalError(
                f"{self.path}: cannot be {action}: {error.strerror}; "
                "what was acknowledged before is kept, and a run that is started again goes on after it"
            ) from error


def _chain(previous: str, key: str, text: str) -> str:
    return _sha256(f"{previous}{key} {text}")


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
