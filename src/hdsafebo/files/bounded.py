"""Files that somebody hands in: how large one is, is known before any of it is read."""

from __future__ import annotations

import stat
from pathlib import Path

from hdsafebo.errors import HdSafeBOError


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
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise error(f"{path}: is no regular file")
        if status.st_size > limit:
            raise error(f"{path}: {status.st_size} bytes, expected at most {limit}")
        with path.open("rb") as file:
            content = file.read(limit + 1)  # the file may have grown since
    except OSError as fault:
        raise error(f"{path}: {fault.strerror or fault}") from None
    if len(content) > limit:
        raise error(f"{path}: more than {limit} bytes")
    return content
