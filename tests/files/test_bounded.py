"""The size of a file is known before it is read."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hdsafebo.errors import HdSafeBOError
from hdsafebo.files.bounded import read_bounded


def test_a_file_within_the_limit_is_read_whole(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert read_bounded(path, 5, HdSafeBOError) == b"12345"
    with pytest.raises(HdSafeBOError, match=r"/a: 5 bytes, expected at most 4"):
        read_bounded(path, 4, HdSafeBOError)


def test_a_file_that_no_memory_could_hold_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "sparse"
    with path.open("wb") as file:
        file.truncate(2**42)
    with pytest.raises(HdSafeBOError, match="4398046511104 bytes, expected at most 33554432"):
        read_bounded(path, 2**25, HdSafeBOError)


def test_what_has_no_size_is_refused(tmp_path: Path) -> None:
    """Opening the pipe would wait for a writer for ever; the device never ends."""
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero"), tmp_path):
        with pytest.raises(HdSafeBOError, match="is no regular file"):
            read_bounded(path, 10, HdSafeBOError)
    with pytest.raises(HdSafeBOError, match="No such file"):
        read_bounded(tmp_path / "absent", 10, HdSafeBOError)
