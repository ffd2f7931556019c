"""Append-only files that survive a kill and a power cut, and a lock that several processes share."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hdsafebo.files.atomic import sync_directory

_POLL_S = 0.01


def make_durable_directory(path: Path) -> None:
    """Make a directory and its parents so that they survive a power cut."""
    missing = [p for p in (path, *path.parents) if not p.exists()]
    path.mkdir(parents=True, exist_ok=True)
    for made in missing:
        sync_directory(made.parent)


def append_durably(file: int, end: int, data: bytes) -> None:
    """Write and sync data behind the byte `end` of an open file, or leave the file as it was.

    Raises:
        OSError: the disk is full or cannot be written.
    """
    try:
        done = 0
        while done < len(data):
            done += os.pwrite(file, data[done:], end + done)
        os.fsync(file)
    except OSError:
        with suppress(OSError):  # if this fails too, the next reader drops the incomplete line
            os.ftruncate(file, end)
        raise


def is_in_place(path: Path, file: int) -> bool:
    """Whether an open file is still the one of that path: neither deleted nor replaced meanwhile."""
    try:
        return os.path.samestat(path.stat(), os.fstat(file))
    except FileNotFoundError:
        return False


@contextmanager
def locked(file: int, wait_s: float | None = None, *, shared: bool = False) -> Iterator[None]:
    """Hold the advisory lock of an open file.

    Args:
        file: its descriptor.
        wait_s: for how long to try; None waits without end.
        shared: others may hold the lock as well, if they share it.

    Raises:
        TimeoutError: somebody else held the lock all the time.
    """
    mode = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
    if wait_s is None:
        fcntl.flock(file, mode)
    else:
        _try_until(file, mode, time.monotonic() + wait_s)
    try:
        yield
    finally:
        fcntl.flock(file, fcntl.LOCK_UN)


def _try_until(file: int, mode: int, end: float) -> None:
    while True:
        try:
            fcntl.flock(file, mode | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if time.monotonic() >= end:
                raise TimeoutError("the lock is held by another program") from None
            time.sleep(_POLL_S)
