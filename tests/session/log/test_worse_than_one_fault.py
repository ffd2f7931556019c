"""What one damaged copy alone does not show: logs that are no logs, lost locks, conversions cut short."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from hdsafebo.session.errors import AuditError, SessionError
from hdsafebo.session.log import layout
from hdsafebo.session.log.layout import log_paths
from hdsafebo.session.log.sqlite_format import FILE_NAME
from hdsafebo.session.log.store import MovedOnError
from hdsafebo.session.session import Session
from hdsafebo.session.views.audit import verify_session

Make = Callable[..., Session]
FORMER = Path(__file__).parents[1] / "data" / "box"


@pytest.mark.parametrize("line", [b"\n", b"x\n"])
def test_a_log_of_millions_of_lines_is_refused_in_moments(tmp_path: Path, line: bytes) -> None:
    """It takes a few kilobytes to send one. Read to its end it would take minutes and gigabytes."""
    for path in log_paths(tmp_path):
        path.parent.mkdir()
        path.write_bytes(line * 20_000_000)
    with pytest.raises(AuditError, match="damaged in both copies"):
        Session.open(tmp_path)


def test_a_copy_of_bad_lines_alone_loses_nothing(make_session: Make) -> None:
    session = make_session()
    session.note("ann", "one")
    log_paths(session.store.directory)[0].write_bytes(b"x\n" * 5000)
    again = Session.open(session.store.directory)
    assert list(again.entries)[: len(session.entries)] == list(session.entries)
    assert again.store.notices[-1].endswith("further lines are damaged, or more")
    verify_session(again)


def test_a_last_row_that_is_cut_in_both_copies_is_no_killed_writer(make_session: Make) -> None:
    """The copy is begun when the original has its row."""
    session = make_session()
    session.note("ann", "acknowledged")
    contents = [path.read_bytes() for path in log_paths(session.store.directory)]
    for path, content in zip(log_paths(session.store.directory), contents, strict=True):
        path.write_bytes(content[:-30])
    with pytest.raises(AuditError, match="cut in both copies"):
        Session.open(session.store.directory)
    log_paths(session.store.directory)[0].write_bytes(contents[0])
    assert list(Session.open(session.store.directory).entries) == list(session.entries)


def test_nothing_is_written_over_an_entry_though_the_lock_is_removed(
    make_session: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two programs that lock two files are both at work; one of them is told so, and records nothing."""
    one = make_session()
    other = Session.open(one.store.directory)
    writing, removed = threading.Event(), threading.Event()
    append = layout.append_durably

    def slowly(file: int, end: int, data: bytes) -> None:
        if threading.current_thread() is not threading.main_thread() and not writing.is_set():
            writing.set()
            assert removed.wait(20)
        append(file, end, data)

    monkeypatch.setattr(layout, "append_durably", slowly)
    thread = threading.Thread(target=one.note, args=("ann", "first"))
    thread.start()
    assert writing.wait(20)
    (one.store.directory / layout.LOCK).unlink()
    threading.Timer(0.3, removed.set).start()
    with pytest.raises(MovedOnError, match="at the same time"):
        other.note("bob", "second")
    thread.join()
    other.note("bob", "second")
    texts = [e.payload["text"] for e in Session.open(one.store.directory).entries if e.kind == "noted"]
    assert texts == ["first", "second"]


@pytest.mark.parametrize("lost", [[0], [1], [0, 1]])
def test_a_conversion_cut_short_before_its_end_does_not_begin_again(tmp_path: Path, lost: list[int]) -> None:
    """The database is still in its place; steps that followed are in the log alone."""
    directory = Path(shutil.copytree(FORMER, tmp_path / "s"))
    Session.open(directory)
    (directory / f"{FILE_NAME}.converted").rename(directory / FILE_NAME)  # killed before it was put aside
    session = Session.open(directory)
    session.note("ann", "since")
    for number in lost:
        log_paths(directory)[number].unlink()
    if len(lost) == 2:
        with pytest.raises(SessionError, match="no session here"):
            Session.open(directory)
    else:
        again = Session.open(directory)
        assert list(again.entries)[: len(session.entries)] == list(session.entries)
        verify_session(again)


def test_a_conversion_cut_short_between_the_two_copies_is_finished(tmp_path: Path) -> None:
    directory = Path(shutil.copytree(FORMER, tmp_path / "s"))
    before = Session.open(directory).entries
    (directory / f"{FILE_NAME}.converted").rename(directory / FILE_NAME)
    log_paths(directory)[0].unlink()
    again = Session.open(directory)
    assert list(again.entries)[: len(before)] == list(before)
    assert (directory / f"{FILE_NAME}.converted").exists()
