"""Optimiser states kept beside the log, so that opening a session does not repeat every fit of its past.

One file, `cache/optimiser`: its SHA-256, the hash of the entry that the states belong to, the length of the
first one, and both. Whatever is wrong with it, the states are computed again from the log.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from pathlib import Path

from hdsafebo.files.atomic import WriteError, replacing
from hdsafebo.files.bounded import read_bounded
from hdsafebo.session.errors import SessionError
from hdsafebo.session.log.chain import Entry

MAX_BYTES = 2**30
_SIGNATURE, _HASH, _LENGTH = 32, 64, 8


class Cache:
    """The cached states of one session.

    Args:
        root: directory of the session.
    """

    def __init__(self, root: Path) -> None:
        self._path = root / "cache" / "optimiser"

    def write(self, entry: Entry, before: bytes, after: bytes) -> None:
        """Keep the states before and after the suggestion of an entry; a disk that is full keeps none."""
        body = entry.hash.encode() + len(before).to_bytes(_LENGTH, "big") + before + after
        with suppress(OSError, WriteError), replacing(self._path) as temporary:
            temporary.write_bytes(hashlib.sha256(body).digest() + body)

    def read(self) -> tuple[str, bytes, bytes] | None:
        """Hash of the entry, state before and after it; None when missing or damaged."""
        try:
            content = read_bounded(self._path, MAX_BYTES, SessionError)
        except SessionError:
            return None
        signature, body = content[:_SIGNATURE], content[_SIGNATURE:]
        if hashlib.sha256(body).digest() != signature:
            return None
        length = int.from_bytes(body[_HASH : _HASH + _LENGTH], "big")
        states = body[_HASH + _LENGTH :]
        return body[:_HASH].decode("ascii", "replace"), states[:length], states[length:]
