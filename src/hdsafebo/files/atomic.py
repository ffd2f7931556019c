"""Files that appear whole or not at all, and a message with the path when they cannot be written."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hdsafebo.errors import HdSafeBOError


class WriteError(HdSafeBOError):
    """A file cannot be written: the disk is full or read-only, or something is in the way."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Write a file under another name and give it its own when it is complete and on the disk.

    Args:
        path: the file; it and its parent directories may be missing.

    Yields:
        Where to write, a path beside `path` with the same suffix.

    Raises:
        WriteError: it cannot be written; what was at `path` before is still there.
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        raise WriteError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            temporary.unlink()
