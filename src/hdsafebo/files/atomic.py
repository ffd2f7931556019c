"""Files that appear whole or not at all, and a message with the path when they cannot be written."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from hdsafebo.errors import HdSafeBOError


class WriteError(HdSafeBOError):
    """A file cannot be written: the disk is full or read-only, or something is in the way."""


@contextmanager
def replacing(path: Path, error: type[HdSafeBOError] = WriteError, *, advice: str = "") -> Iterator[Path]:
    """Write a file under another name, and rename the file when it is complete and on the disk.

    A symbolic link stays a link, and the file that it points to is replaced. The permissions of a file that
    is replaced are kept; a new file gets the permissions that `open` would give.

    Args:
        path: the file; it and its parent directories may be missing.
        error: what is raised.
        advice: end of the message, what is kept or what to do next.

    Yields:
        Where to write, a path in the same directory with the same suffix. The writer may close
        the file at once: this function flushes the content to the disk.

    Raises:
        HdSafeBOError: as `error`: the file cannot be written; what was at `path` before is still there.
    """
    temporary = None
    try:
        target = Path(os.path.realpath(path))
        target.parent.mkdir(parents=True, exist_ok=True)
        # Processes and threads may write the same file at once: the last complete one stays.
        temporary = target.with_name(f".{target.stem}.{os.getpid()}-{secrets.token_hex(4)}{target.suffix}")
        yield temporary
        with suppress(FileNotFoundError):  # a circle of links is refused here
            temporary.chmod(target.stat().st_mode)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(target)
        sync_directory(target.parent)
    except OSError as fault:
        reason = f"{path}: cannot be written: {fault.strerror or fault}"
        raise error(f"{reason}; {advice}" if advice else reason) from fault
    finally:
        if temporary is not None:
            with suppress(OSError):
                temporary.unlink()


def write_json(
    path: Path, content: Any, error: type[HdSafeBOError] = WriteError, *, sort_keys: bool = False
) -> None:
    """Write plain data with finite numbers for people to read; see `replacing`.

    Raises:
        HdSafeBOError: as `error`: the file cannot be written.
        ValueError: a number is NaN or infinite.
    """
    text = json.dumps(content, indent=1, sort_keys=sort_keys, allow_nan=False, ensure_ascii=False) + "\n"
    with replacing(path, error) as temporary:
        temporary.write_text(text, encoding="utf-8")


def sync_directory(path: Path) -> None:
    """Make the entries of a directory durable."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
