"""Files appear whole or not at all, with the permissions that any new or changed file would have."""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from hdsafebo.errors import DatasetError
from hdsafebo.files.atomic import WriteError, replacing


@pytest.fixture(params=[0o022, 0o077, 0o002])
def umask(request: pytest.FixtureRequest) -> Iterator[int]:
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def write(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text)


def mode(path: Path) -> int:
    return path.stat().st_mode & 0o777


def test_a_new_file_has_the_permissions_that_the_umask_leaves(tmp_path: Path, umask: int) -> None:
    write(tmp_path / "deep" / "new", "text")
    assert mode(tmp_path / "deep" / "new") == 0o666 & ~umask


@pytest.mark.parametrize("own", [0o600, 0o644, 0o660, 0o400])
def test_a_file_keeps_its_own_permissions(tmp_path: Path, umask: int, own: int) -> None:
    path = tmp_path / "old"
    path.write_text("old")
    path.chmod(own)
    write(path, "new")
    assert (path.read_text(), mode(path)) == ("new", own)


def test_a_link_stays_one(tmp_path: Path) -> None:
    target, link, second = tmp_path / "there" / "file", tmp_path / "link", tmp_path / "second"
    target.parent.mkdir()
    link.symlink_to(Path("there") / "file")
    second.symlink_to(link)
    for text, path in (("made through a link", link), ("replaced", link), ("through two", second)):
        write(path, text)
        assert link.is_symlink()
        assert second.is_symlink()
        assert target.read_text() == text
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["file", "link", "second", "there"]


def test_links_in_a_circle_are_named(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(WriteError, match="a: cannot be written"):
        write(tmp_path / "a", "text")


def test_nothing_stays_of_a_file_that_was_not_completed(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("old")

    def interrupted() -> None:
        with replacing(path) as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_many_threads_write_one_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    texts = [str(i) * 10_000 for i in range(10)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda text: write(path, text), texts * 5))
    assert path.read_text() in texts
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


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
