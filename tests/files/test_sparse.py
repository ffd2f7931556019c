"""Copies that take no more room than what is copied."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hdsafebo.files.sparse import copy_sparse


def _with_holes(path: Path, pieces: dict[int, bytes], size: int) -> None:
    with path.open("wb") as file:
        file.truncate(size)
        for place, content in pieces.items():
            file.seek(place)
            file.write(content)


@pytest.mark.parametrize("pieces", [{}, {0: b"a" * 5000}, {2**20: b"b" * 3_000_000, 2**33 - 7: b"c" * 7}])
def test_holes_stay_holes(tmp_path: Path, pieces: dict[int, bytes]) -> None:
    source, target = tmp_path / "a", tmp_path / "b"
    _with_holes(source, pieces, 2**33)
    target.write_bytes(b"what was there before")
    copy_sparse(source, target, 2**40)
    assert target.stat().st_size == 2**33
    assert target.stat().st_blocks <= source.stat().st_blocks + 64
    with target.open("rb") as file:
        for place, content in pieces.items():
            file.seek(place)
            assert file.read(len(content)) == content


@pytest.mark.parametrize("size", [0, 1, 4999, 5000, 5001, 2**40])
def test_no_more_than_asked_for_is_copied(tmp_path: Path, size: int) -> None:
    source, target = tmp_path / "a", tmp_path / "b"
    source.write_bytes(os.urandom(5000))
    copy_sparse(source, target, size)
    assert target.read_bytes() == source.read_bytes()[:size]


def test_a_pipe_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a")
    with pytest.raises(OSError, match="no regular file"):
        copy_sparse(tmp_path / "a", tmp_path / "b", 10)
    assert not (tmp_path / "b").exists()
