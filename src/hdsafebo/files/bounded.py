"""Files that somebody hands in: how large one is, is known before any of it is read."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

from hdsafebo.errors import HdSafeBOError


def open_regular(path: Path) -> BinaryIO:
    """Open a file for reading, if it is a regular one: opening or reading a pipe or a device may never end.

    Raises:
        OSError: it cannot be opened, or is something else.
    """
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, "is no regular file", str(path))
    return os.fdopen(handle, "rb")


def require_regular(path: Path) -> None:
    """Nothing for a regular file, for readers that open files themselves; see `open_regular`.

    Raises:
        OSError: it cannot be opened, or is something else.
    """
    open_regular(path).close()


def read_bytes(path: Path) -> bytes:
    """Content of a regular file that the pipeline itself wrote, so that its size needs no bound.

    Raises:
        OSError: it cannot be read, or is something else.
    """
    with open_regular(path) as file:
        return file.read()


def read_text(path: Path) -> str:
    """The same as text.

    Raises:
        OSError: as `read_bytes`.
        UnicodeDecodeError: it is no UTF-8.
    """
    return read_bytes(path).decode("utf-8").replace("\r\n", "\n")


def read_bounded(path: Path, limit: int, error: type[HdSafeBOError]) -> bytes:
    """Content of a file of bounded size.

    Args:
        path: the file.
        limit: largest size, in bytes.
        error: what is raised.

    Raises:
        HdSafeBOError: as `error`: the file cannot be read, is larger, or is no regular file (a pipe or a
            device has no size, and reading it may never end).
    """
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            if size > limit:
                raise error(f"{path}: {size} bytes, expected at most {limit}")
            content = file.read(limit + 1)  # the file may have grown since
    except OSError as fault:
        raise error(f"{path}: {fault.strerror or fault}") from None
    if len(content) > limit:
        raise error(f"{path}: more than {limit} bytes")
    return content
