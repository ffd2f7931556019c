"""Files that appear whole or not at all, and a message with the path when they cannot be written."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from hdsafebo.errors import HdSafeBOError


class WriteError(HdSafeBOError):
    """A file cannot be written: the disk is full or read-only, or something is in the way."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Write a file under another name and give it its own when it is complete and on the disk.

    A new file has the permissions that the umask leaves; one that is replaced keeps its own. A symbolic link
    stays one, and the file it leads to is replaced.

    Args:
        path: the file; it and its parent directories may be missing.

    Yields:
        Where to write, a path beside the file with the same suffix.

    Raises:
        WriteError: it cannot be written; what was at `path` before is still there.
    """
    target = Path(os.path.realpath(path))
    # Several processes, and several threads of one, may write the same file at the same time.
    temporary = target.with_name(f".{target.stem}.{os.getpid()}-{uuid4().hex[:8]}{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        with suppress(FileNotFoundError):
            temporary.chmod(target.stat().st_mode)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(target)
        _flush_names(target.parent)
    except OSError as error:
        raise WriteError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def _flush_names(folder: Path) -> None:
    """Bring the new name of a file to the disk, where folders can be flushed (not on Windows)."""
    if hasattr(os, "O_DIRECTORY"):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
