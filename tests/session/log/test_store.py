"""The log: every change is noticed, nothing acknowledged is lost, nothing is written twice."""

from __future__ import annotations

import multiprocessing
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hdsafebo.session.errors import AuditError, ProtocolError, SessionError
from hdsafebo.session.log.chain import read_lines, write_lines
from hdsafebo.session.log.store import FILE_NAME
from hdsafebo.session.session import Session
from hdsafebo.session.views.audit import replay, verify_export, verify_session
from tests.session.small import approve_open, measured, refuse_open

Make = Callable[..., Session]


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


def test_a_thousand_flipped_bytes_in_the_log_are_all_noticed(worked: Session) -> None:
    good = write_lines(worked.store.lines())
    assert [e.hash for e in read_lines(good)] == [e.hash for e in worked.entries]
    rng = np.random.default_rng(0)
    for _ in range(1000):
        bad = bytearray(good)
        bad[rng.integers(len(bad))] ^= int(rng.integers(1, 256))
        with pytest.raises(AuditError):
            read_lines(bytes(bad))


def test_cut_moved_and_rebuilt_logs_are_noticed(worked: Session, tmp_path: Path) -> None:
    pairs = worked.store.lines()
    head = worked.entries[-1].hash
    path = tmp_path / "audit.log"
    for bad in (
        pairs[1:],
        pairs[:2] + pairs[3:],
        [*pairs[:2], pairs[3], pairs[2], *pairs[4:]],
        [*pairs, pairs[-1]],
    ):
        path.write_bytes(write_lines(bad))
        with pytest.raises(AuditError):
            verify_export(path)
    path.write_bytes(write_lines(pairs)[:-5])
    with pytest.raises(AuditError, match="the last line is cut"):
        verify_export(path)
    path.write_bytes(write_lines(pairs[:-1]))
    assert verify_export(path).entries == len(pairs) - 1  # a shorter chain is a chain ...
    with pytest.raises(AuditError, match="no entry has the noted hash"):
        verify_export(path, head=head)  # ... which the noted head gives away
    path.write_bytes(write_lines(pairs))
    assert verify_export(path, head=head).head == head


def test_flipped_bytes_of_the_database_never_change_what_is_read(worked: Session) -> None:
    """Bytes of a database that hold nothing may flip unseen; whatever is read must be what was written."""
    worked.store._db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    good_lines = worked.store.lines()
    worked.close()
    good = worked.store.path.read_bytes()
    rng = np.random.default_rng(1)
    noticed = 0
    for _ in range(150):
        bad = bytearray(good)
        bad[rng.integers(len(bad))] ^= int(rng.integers(1, 256))
        worked.store.path.write_bytes(bytes(bad))
        try:
            session = Session.open(worked.store.directory)
            verify_session(session)
            assert session.store.lines() == good_lines
            session.close()
        except SessionError:
            noticed += 1
    assert noticed > 10


def test_changing_a_row_by_hand_is_noticed(worked: Session) -> None:
    database = sqlite3.connect(worked.store.path)
    with pytest.raises(sqlite3.IntegrityError, match="append-only"):
        database.execute("UPDATE log SET line = line WHERE seq = 3")
    with pytest.raises(sqlite3.IntegrityError, match="append-only"):
        database.execute("DELETE FROM log WHERE seq = 3")
    database.execute("DROP TRIGGER log_keeps")
    line = database.execute("SELECT line FROM log WHERE seq = 3").fetchone()[0]
    database.execute("UPDATE log SET line = ? WHERE seq = 3", (line.replace(b"ann", b"bob"),))
    database.commit()
    database.close()
    with pytest.raises(AuditError, match="entry 3 was changed"):
        Session.open(worked.store.directory)


def test_a_changed_file_is_noticed(worked: Session) -> None:
    database = sqlite3.connect(worked.store.path)
    database.execute("UPDATE file SET content = X'00'")
    database.commit()
    database.close()
    with pytest.raises(AuditError, match="is missing or was changed"):
        verify_session(worked)


def test_replay_reproduces_every_suggestion_and_notices_one_that_was_not_computed(worked: Session) -> None:
    assert replay(worked) == []
    worked.suggest("ann")
    worked.entries[-1].payload["belief"]["safe_probability"] = 0.123
    assert [m.suggestion for m in replay(worked)] == [5]


def test_a_damaged_cache_is_left_aside(worked: Session) -> None:
    expected = worked.suggest("ann")
    worked.record("ann", measured(approve_open(worked)))
    following = worked.suggest("ann").point
    refuse_open(worked, "no")
    worked.close()
    database = sqlite3.connect(worked.store.path)
    database.execute("UPDATE cache SET content = zeroblob(length(content))")
    database.commit()
    database.close()
    session = Session.open(worked.store.directory)
    assert session.advisor().mismatches == []
    assert session.state.suggestions[-2].point == expected.point
    assert session.state.suggestions[-1].point == following


@pytest.mark.parametrize("content", [b"", b"not a database", b"SQLite format 3\x00" + bytes(4000)])
def test_foreign_files_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / FILE_NAME).write_bytes(content)
    with pytest.raises(SessionError, match=FILE_NAME):
        Session.open(tmp_path)


def test_another_programs_database_is_refused(tmp_path: Path) -> None:
    database = sqlite3.connect(tmp_path / FILE_NAME)
    database.execute("CREATE TABLE log (seq, line, hash)")
    database.commit()
    database.close()
    with pytest.raises(SessionError, match="no session store of this version"):
        Session.open(tmp_path)


def test_a_full_disk_loses_nothing(worked: Session) -> None:
    database = worked.store._db
    pages = database.execute("PRAGMA page_count").fetchone()[0]
    database.execute(f"PRAGMA max_page_count = {pages}")
    refused = ""
    while not refused:
        head = worked.entries[-1]
        try:
            worked.note("ann", "x" * 2000)
        except SessionError as error:
            refused = str(error)
    assert "full" in refused
    assert "nothing was recorded" in refused
    database.execute("PRAGMA max_page_count = 1000000")
    assert Session.open(worked.store.directory).entries[-1] == head
    worked.note("ann", "space is back")


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
