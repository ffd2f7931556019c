"""A file is replaced whole, with its permissions, its link and the caller's error."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from hdsafebo.errors import DatasetError
from hdsafebo.files.atomic import WriteError, replacing


def write(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text)


def test_a_block_that_fails_leaves_the_old_file_and_nothing_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write(path, "old")

    def fail_halfway() -> None:
        with replacing(path) as temporary:
            temporary.write_text("new")
            raise KeyError

    with pytest.raises(KeyError):
        fail_halfway()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_error_is_the_callers_with_path_reason_and_advice(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    path = tmp_path / "file" / "a.txt"
    with (
        pytest.raises(DatasetError, match=r"file/a\.txt: cannot be written: .*; the runs are kept"),
        replacing(path, DatasetError, advice="the runs are kept"),
    ):
        pass
    with pytest.raises(WriteError, match="cannot be written"):
        write(path, "text")


def test_a_new_file_has_the_permissions_that_open_gives(tmp_path: Path) -> None:
    mask = os.umask(0o027)
    try:
        write(tmp_path / "a.txt", "text")
    finally:
        os.umask(mask)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o640


def test_permissions_and_links_are_kept(tmp_path: Path) -> None:
    target, link = tmp_path / "elsewhere" / "a.txt", tmp_path / "a.txt"
    write(target, "old")
    target.chmod(0o604)
    link.symlink_to(target)
    write(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    assert target.stat().st_mode & 0o777 == 0o604


def test_many_writers_of_one_file_leave_one_whole_text(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    texts = [str(k) * 100_000 for k in range(8)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda text: write(path, text), texts))
    assert path.read_text() in texts
    assert list(tmp_path.iterdir()) == [path]
