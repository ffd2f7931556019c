"""The store: every change is noticed, nothing acknowledged is lost, nothing is written twice."""

from __future__ import annotations

import errno
import multiprocessing
import os
import shutil
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hdsafebo.session.errors import AuditError, ProtocolError, SessionError
from hdsafebo.session.log import layout
from hdsafebo.session.log.chain import Entry, canonical, read_log, write_rows
from hdsafebo.session.log.copies import read_copies
from hdsafebo.session.log.layout import log_paths
from hdsafebo.session.log.stops import PREFIX, press
from hdsafebo.session.log.store import utc_now
from hdsafebo.session.session import Session
from hdsafebo.session.views.audit import replay, verify_export, verify_session
from hdsafebo.session.views.export import export_session
from hdsafebo.session.views.report import write_report
from tests.session.faults import Killed, failing
from tests.session.small import approve_open, measured, refuse_open

Make = Callable[..., Session]
_COPIES = ["original/audit.log", "copy/audit.log"]


@pytest.fixture
def worked(make_session: Make) -> Session:
    """A session with a few trials."""
    session = make_session()
    for i in range(4):
        session.suggest("ann")
        if i == 1:
            refuse_open(session, "no")
        else:
            session.record("ann", measured(approve_open(session)))
    session.note("ann", "µ and ± survive")
    return session


def hashes(session: Session) -> list[str]:
    return [e.hash for e in session.entries]


def verdict(directory: Path) -> str:
    """What `verify` finds wrong; empty when it calls the session intact."""
    try:
        verify_session(Session.open(directory, read_only=True))
    except SessionError as error:
        return str(error)
    return ""


# --- a log by itself


def test_a_thousand_flipped_bytes_in_an_exported_log_are_all_noticed(worked: Session, tmp_path: Path) -> None:
    path = tmp_path / "audit.log"
    good = write_rows(list(worked.entries))
    path.write_bytes(good)
    assert [e.hash for e in read_log(path)] == hashes(worked)
    rng = np.random.default_rng(0)
    for _ in range(1000):
        path.write_bytes(flipped(good, rng))
        with pytest.raises(AuditError):
            read_log(path)


def flipped(content: bytes, rng: np.random.Generator) -> bytes:
    bad = bytearray(content)
    bad[rng.integers(len(bad))] ^= int(rng.integers(1, 256))
    return bytes(bad)


def test_cut_moved_and_rebuilt_logs_are_noticed(worked: Session, tmp_path: Path) -> None:
    rows = write_rows(list(worked.entries)).splitlines(keepends=True)
    head = worked.entries[-1].hash
    path = tmp_path / "audit.log"
    for bad in (
        rows[1:],
        rows[:2] + rows[3:],
        [*rows[:2], rows[3], rows[2], *rows[4:]],
        [*rows, rows[-1]],
    ):
        path.write_bytes(b"".join(bad))
        with pytest.raises(AuditError):
            verify_export(path)
    path.write_bytes(b"".join(rows)[:-5])
    with pytest.raises(AuditError, match="the last line is cut"):
        verify_export(path)
    path.write_bytes(b"".join(rows[:-1]))
    assert verify_export(path).entries == len(rows) - 1  # a shorter chain is a chain ...
    with pytest.raises(AuditError, match="no entry has the noted hash"):
        verify_export(path, head=head)  # ... which the noted head gives away
    path.write_bytes(b"".join(rows))
    assert verify_export(path, head=head).head == head


def test_a_name_that_stands_twice_in_an_entry_is_noticed(worked: Session, tmp_path: Path) -> None:
    """JSON readers take the last of two values; a canonical line has one."""
    import hashlib

    line = canonical({"seq": 1}).replace(b'{"seq":1}', b'{"kind":"noted","kind":"created"}')
    path = tmp_path / "audit.log"
    path.write_bytes(hashlib.sha256(line).hexdigest().encode() + b" " + line + b"\n")
    with pytest.raises(AuditError, match="canonical"):
        read_log(path)


def test_a_sparse_log_is_refused_without_being_read(tmp_path: Path) -> None:
    path = tmp_path / "audit.log"
    for size, message in ((2**33, "expected at most"), (2**28, "the last line is cut, or longer")):
        with path.open("wb") as file:
            file.truncate(size)
        with pytest.raises(AuditError, match=message):
            verify_export(path)


# --- two copies


@pytest.mark.parametrize("name", _COPIES)
@pytest.mark.parametrize("fault", ["gone", "empty", "half", "zeros", "another", "line lost", "line moved"])
def test_one_spoilt_copy_loses_nothing_and_is_said(
    worked: Session, make_session: Make, name: str, fault: str
) -> None:
    directory, path = worked.store.directory, worked.store.directory / name
    good, content = hashes(worked), path.read_bytes()
    rows = content.splitlines(keepends=True)
    if fault == "gone":
        path.unlink()
    else:
        other = write_rows(list(make_session(name="other").entries))
        path.write_bytes(
            {
                "empty": b"",
                "half": content[: len(content) // 2],
                "zeros": bytes(len(content)),
                "another": other,
                "line lost": b"".join(rows[:3] + rows[4:]),
                "line moved": b"".join([*rows[:3], rows[4], rows[3], *rows[5:]]),
            }[fault]
        )
    if fault == "another":
        with pytest.raises(AuditError, match="another one than in the other copy"):
            Session.open(directory)
        return
    assert name in verdict(directory)
    assert "Nothing is lost" in verdict(directory)
    session = Session.open(directory)
    assert hashes(session)[: len(good)] == good
    assert session.entries[-1].kind == "repaired"
    assert any(name in text for text in session.entries[-1].payload["damage"])
    assert verdict(directory) == ""
    assert path.read_bytes() == (directory / _COPIES[0]).read_bytes()


def test_the_same_entry_damaged_in_both_copies_is_named(worked: Session) -> None:
    for number, place in (
        (5, "entry 5 is damaged in both copies"),
        (len(worked.entries), "what follows entry"),
    ):
        for path in log_paths(worked.store.directory):
            rows = write_rows(list(worked.entries)).splitlines(keepends=True)
            rows[number - 1] = rows[number - 1].replace(b"seq", b"sex")
            path.write_bytes(b"".join(rows))
        with pytest.raises(AuditError, match=place):
            Session.open(worked.store.directory)


def spoil_by_a_byte(session: Session, flips: int, seed: int) -> int:
    """Flip single bytes of every file; returns how many of the flips were noticed by `verify`."""
    original = session.store.directory
    good = hashes(session)
    rng = np.random.default_rng(seed)
    files = [p for p in sorted(original.rglob("*")) if p.is_file() and p.stat().st_size]
    noticed = 0
    for number in range(flips):
        copy = original.with_name("flipped")
        shutil.copytree(original, copy)
        path = copy / files[number % len(files)].relative_to(original)
        path.write_bytes(flipped(path.read_bytes(), rng))
        said = verdict(copy)
        noticed += bool(said)
        harmless = path.parent.name == "cache" or path.name.startswith(PREFIX)
        behind = path.name == "audit.log" and path.parent.name == "copy"  # as a killed writer leaves it
        assert said or harmless or behind, f"a flip in {path} went unnoticed"
        again = Session.open(copy)
        assert hashes(again)[: len(good)] == good, f"a flip in {path} lost an entry"
        for file in original.glob("*/files/*"):
            assert again.store.attachments.content(file.name) == file.read_bytes()
        if any(p.name.startswith(PREFIX) for p in files):
            assert again.stopped is not None, f"a flip in {path} lost a stop"
        shutil.rmtree(copy)
    return noticed


def test_a_flipped_byte_anywhere_loses_nothing(worked: Session) -> None:
    worked.suggest("ann")
    assert spoil_by_a_byte(worked, 60, seed=1) > 40
    press(worked.store.directory, "ann", "it hurts", utc_now())
    assert spoil_by_a_byte(worked, 30, seed=2) > 15


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_thousand_flipped_bytes_anywhere_lose_nothing(worked: Session) -> None:
    worked.suggest("ann")
    assert spoil_by_a_byte(worked, 700, seed=3) > 500
    press(worked.store.directory, "ann", "it hurts", utc_now())
    assert spoil_by_a_byte(worked, 300, seed=4) > 150  # a third of the files are those of which nothing hangs


def test_every_byte_of_the_last_row_counts_in_either_copy(worked: Session) -> None:
    good = hashes(worked)
    row = len(write_rows([worked.entries[-1]]))
    for path in log_paths(worked.store.directory):
        content = path.read_bytes()
        for place in range(len(content) - row, len(content)):
            bad = bytearray(content)
            bad[place] ^= 1
            path.write_bytes(bytes(bad))
            assert [e.hash for e in read_copies(log_paths(worked.store.directory)).entries] == good
        path.write_bytes(content)


def test_a_damaged_file_is_taken_from_its_other_copy_and_said(worked: Session) -> None:
    directory = worked.store.directory
    for path in (directory / "original" / "files").iterdir():
        path.write_bytes(b"\0" + path.read_bytes()[1:])
    assert "is missing or was changed" in verdict(directory)
    assert replay(Session.open(directory)) == []
    assert len(worked.store.repair()) == 1
    assert verdict(directory) == ""
    for path in directory.glob("*/files/*"):
        path.write_bytes(b"")
    with pytest.raises(AuditError, match="in both copies"):
        Session.open(directory)


def test_a_damaged_cache_is_left_aside(worked: Session) -> None:
    expected = worked.suggest("ann")
    worked.record("ann", measured(approve_open(worked)))
    following = worked.suggest("ann").point
    refuse_open(worked, "no")
    path = worked.store.directory / "cache" / "optimiser"
    path.write_bytes(bytes(path.stat().st_size))
    session = Session.open(worked.store.directory)
    assert session.advisor().mismatches == []
    assert session.state.suggestions[-2].point == expected.point
    assert session.state.suggestions[-1].point == following


# --- under an open session


def test_what_is_deleted_under_an_open_session_is_noticed(worked: Session) -> None:
    directory = worked.store.directory
    for path in log_paths(directory):
        path.unlink()
        worked.note("ann", f"{path.parent.name} is gone")  # restored from the other one, and recorded
        assert {e.kind for e in worked.entries[-2:]} == {"noted", "repaired"}
        assert verdict(directory) == ""
    entries = len(worked.entries)
    for path in log_paths(directory):
        path.unlink()
    with pytest.raises(SessionError, match=r"gone.*nothing was recorded"):
        worked.note("ann", "lost")
    assert len(worked.entries) == entries
    directory.rename(directory.with_name("moved"))
    with pytest.raises(SessionError, match="nothing was recorded"):
        worked.note("ann", "lost")


def test_a_log_that_is_replaced_under_an_open_session_is_noticed(worked: Session, make_session: Make) -> None:
    other = make_session(name="other")
    for mine, others in zip(log_paths(worked.store.directory), log_paths(other.store.directory), strict=True):
        shutil.copyfile(others, mine)
    with pytest.raises(AuditError, match="gone, cut or replaced"):
        worked.note("ann", "into another's log")


def test_a_copy_made_while_steps_are_taken_holds_what_was_acknowledged_before(
    worked: Session, tmp_path: Path
) -> None:
    directory = worked.store.directory
    enough = threading.Event()

    def work() -> None:
        session = Session.open(directory)
        for number in range(10_000):
            session.note("ann", f"{number} ")
            if enough.is_set():
                return

    worker = threading.Thread(target=work)
    worker.start()
    try:
        for number in range(6):
            reader = Session.open(directory)
            shutil.copytree(directory, tmp_path / f"copy{number}")
            copied = Session.open(tmp_path / f"copy{number}")
            assert hashes(copied)[: len(reader.entries)] == hashes(reader)
            backup = reader.store.back_up(tmp_path / f"backup{number}")
            assert verdict(tmp_path / f"backup{number}") == ""
            assert backup.seq >= len(reader.entries)
    finally:
        enough.set()
        worker.join()


def test_a_backup_is_a_session_that_goes_on(worked: Session, tmp_path: Path) -> None:
    head = worked.store.back_up(tmp_path / "backup")
    assert head == worked.entries[-1]
    backup = Session.open(tmp_path / "backup")
    assert replay(backup) == []
    assert backup.suggest("ann").point == worked.suggest("ann").point
    with pytest.raises(SessionError, match="exists already"):
        worked.store.back_up(tmp_path / "backup")


# --- interrupted, full, read-only


@pytest.mark.parametrize("fault", [Killed(), OSError(errno.ENOSPC, "No space left on device")])
@pytest.mark.parametrize("stopped", [False, True])
def test_a_step_that_fails_anywhere_is_whole_or_nothing(
    worked: Session, monkeypatch: pytest.MonkeyPatch, fault: BaseException, stopped: bool
) -> None:
    directory = worked.store.directory
    good = hashes(worked)
    for at in range(1, 12):
        session = Session.open(directory)
        acknowledged = False
        with failing(monkeypatch, at, fault) as calls:
            try:
                if stopped:
                    session.stop("ann", f"stop {at}")
                else:
                    session.note("ann", f"note {at}")
                acknowledged = True
            except (Killed, SessionError):
                pass
        again = Session.open(directory)
        assert hashes(again)[: len(good)] == good
        words = [e.payload.get("text", e.payload.get("reason")) for e in again.entries[len(good) :]]
        mine = [w for w in words if w in (f"stop {at}", f"note {at}")]
        assert len(mine) <= 1
        if acknowledged and not stopped:
            assert len(mine) == 1
        if stopped and (acknowledged or len(calls) > 1):
            assert again.stopped is not None
            again.resume("ann")
        assert verdict(directory) == ""
        good = hashes(again)


def test_a_step_that_only_one_copy_could_take_is_in_neither(
    worked: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The person is told that nothing was recorded; a row that is whole in one copy would count."""
    paths = log_paths(worked.store.directory)
    before = [path.read_bytes() for path in paths]
    real, files = layout.append_durably, []

    def second_is_full(file: int, end: int, data: bytes) -> None:
        files.append(file)
        if len(files) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        real(file, end, data)

    with monkeypatch.context() as patch:
        patch.setattr(layout, "append_durably", second_is_full)
        with pytest.raises(SessionError, match="nothing was recorded"):
            worked.note("ann", "refused")
    assert len(files) == 2
    assert [path.read_bytes() for path in paths] == before
    assert hashes(Session.open(worked.store.directory)) == hashes(worked)


@pytest.fixture
def read_only(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """Makes a folder read-only, for the superuser as well."""

    def protect(folder: Path) -> None:
        refused = OSError(errno.EROFS, "Read-only file system", str(folder))

        def inside(path: object) -> bool:
            return isinstance(path, str | os.PathLike) and Path(os.fspath(path)).is_relative_to(folder)  # type: ignore[arg-type]

        def guard(owner: object, name: str, changes: Callable[..., bool]) -> None:
            real = getattr(owner, name)

            def call(*arguments: object, **named: object) -> object:
                if inside(arguments[0]) and changes(*arguments, **named):
                    raise refused
                return real(*arguments, **named)

            monkeypatch.setattr(owner, name, call)

        writing = os.O_WRONLY | os.O_RDWR | os.O_CREAT
        guard(os, "open", lambda path, flags, *rest, **named: bool(flags & writing))
        guard(Path, "open", lambda path, mode="r", *rest, **named: set(mode) & set("wax+"))
        for name in ("mkdir", "rename", "unlink", "replace", "rmdir"):
            guard(os, name, lambda *rest, **named: True)

    return protect


@pytest.mark.parametrize("damaged", [False, True])
def test_a_read_only_folder_can_be_looked_at_in_every_way(
    worked: Session, tmp_path: Path, read_only: Callable[[Path], None], damaged: bool
) -> None:
    directory = worked.store.directory
    shutil.rmtree(directory / "cache")
    if damaged:
        (directory / _COPIES[1]).write_bytes(b"")
    (directory / "lock").unlink()
    before = {p: p.read_bytes() for p in directory.rglob("*") if p.is_file()}
    read_only(directory)
    session = Session.open(directory)
    assert hashes(session) == hashes(worked)
    assert replay(session) == []
    assert session.believe(worked.state.trials[-1].point) is not None
    export_session(session, tmp_path / "out")
    assert verify_export(tmp_path / "out" / "audit.log").entries == len(session.entries)
    if damaged:
        assert session.store.notices
        assert "copy/audit.log" in verdict(directory)
    else:
        verify_session(session)
        write_report(session, tmp_path / "report.html")
    with pytest.raises(SessionError, match="cannot be written; nothing was recorded"):
        session.note("ann", "no")
    with pytest.raises(SessionError, match="no trial can be started from here either"):
        session.stop("ann", "no")
    assert {p: p.read_bytes() for p in directory.rglob("*") if p.is_file()} == before


# --- other programs, other people


@pytest.mark.parametrize("content", [b"", b"not a log", bytes(4000), b"0" * 64 + b" {}\n"])
def test_foreign_files_are_refused(tmp_path: Path, content: bytes) -> None:
    for path in log_paths(tmp_path):
        path.parent.mkdir()
        path.write_bytes(content)
    with pytest.raises(SessionError):
        Session.open(tmp_path)


def test_opening_what_is_no_session_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="no session here"):
        Session.open(tmp_path)
    assert list(tmp_path.iterdir()) == []


def _noter(directory: Path, number: int, done: multiprocessing.Queue) -> None:  # type: ignore[type-arg]
    session = Session.open(directory)
    written = 0
    while written < 20:
        try:
            session.note(f"p{number}", f"note {written}")
            written += 1
        except ProtocolError:
            continue  # another process was faster: nothing was written
    done.put(number)


def test_many_processes_write_one_log(worked: Session) -> None:
    context = multiprocessing.get_context("spawn")
    done: multiprocessing.Queue = context.Queue()  # type: ignore[type-arg]
    workers = [context.Process(target=_noter, args=(worked.store.directory, i, done)) for i in range(3)]
    for w in workers:
        w.start()
    for w in workers:
        w.join(120)
        assert w.exitcode == 0
    session = Session.open(worked.store.directory)
    notes = [(e.who, e.payload["text"]) for e in session.entries if e.kind == "noted" and e.who != "ann"]
    assert sorted(notes) == sorted((f"p{i}", f"note {k}") for i in range(3) for k in range(20))
    assert verdict(worked.store.directory) == ""


def test_replay_reproduces_every_suggestion_and_notices_one_that_was_not_computed(worked: Session) -> None:
    assert replay(worked) == []
    worked.suggest("ann")
    last: Entry = worked.entries[-1]
    last.payload["belief"]["safe_probability"] = 0.123
    assert [m.suggestion for m in replay(worked)] == [5]
