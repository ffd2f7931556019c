"""Files with holes: one may be far longer than the room that it takes on the disk."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from hdsafebo.files.bounded import open_regular

_CHUNK = 2**20


def copy_sparse(source: Path, target: Path, size: int) -> None:
    """Copy the beginning of a regular file; the copy takes no more room on the disk than the file does.

    Args:
        source: the file.
        target: is made or replaced.
        size: bytes to copy, or all of a file that is shorter.

    Raises:
        OSError: the source cannot be read or is no regular file, or the target cannot be written.
    """
    with open_regular(source) as file, target.open("wb") as copy:
        size = min(size, os.fstat(file.fileno()).st_size)
        copy.truncate(size)
        for place, piece in pieces_of_data(file, size):
            copy.seek(place)
            copy.write(piece)


def pieces_of_data(file: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
    """What a file holds apart from holes: places, and what begins there, in pieces of at most a mebibyte.

    Args:
        file: a regular file.
        size: where to end.

    Raises:
        OSError: it cannot be read.
    """
    end = 0
    while (start := _next_data(file.fileno(), end, size)) < size:
        end = min(os.lseek(file.fileno(), start, os.SEEK_HOLE), size)
        file.seek(start)
        while (left := end - start) > 0 and (piece := file.read(min(_CHUNK, left))):
            yield start, piece
            start += len(piece)


def _next_data(file: int, start: int, size: int) -> int:
    """Where the next bytes lie that are no hole; the size when there are none."""
    try:
        return os.lseek(file, start, os.SEEK_DATA)
    except OSError as error:
        if error.errno == errno.ENXIO:
            return size
        raise
