"""Sessions of the former SQLite format: converted with nothing lost, or refused by name."""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
from pathlib import Path

import numpy as np
import pytest

from hdsafebo.files.sparse import copy_sparse
from hdsafebo.session.errors import AuditError, SessionError
from hdsafebo.session.log import sqlite_format
from hdsafebo.session.log.sqlite_format import FILE_NAME, MAX_BYTES, MAX_WAL_BYTES
from hdsafebo.session.session import Session
from hdsafebo.session.views.audit import replay, verify_session
from tests.session.small import approve_open, measured

DATA = Path(__file__).parents[1] / "data"  # made by version 1 of the format: 27 entries each
HEADS = {
    "box": "bc015adfafd902b0dc3e77e7fee5e934e1c5191c41292424def645d3817212fd",
    "list": "1455a5ce8eeff8ff1b7df2e4671636a638d2211e02a5bbe22d1437cf4b672f1a",
}


@pytest.fixture(params=["box", "list"])
def former(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A session of the former format: decisions of all kinds, a pause, another target."""
    return Path(shutil.copytree(DATA / request.param, tmp_path / request.param))


def test_it_is_converted_with_nothing_lost(former: Path) -> None:
    content = (former / FILE_NAME).read_bytes()
    session = Session.open(former)
    assert session.entries[-2].hash == HEADS[former.name]
    assert [e.kind for e in session.entries].count("recorded") == 7
    assert (session.entries[-1].kind, session.entries[-1].payload["entries"]) == ("converted", 27)
    assert (former / f"{FILE_NAME}.converted").read_bytes() == content
    assert not (former / FILE_NAME).exists()
    assert verify_session(session, head=HEADS[former.name]).entries == 28
    kept = session.cache.read()
    assert kept is not None
    assert kept[0] == session.entries[25].hash  # of the last suggestion: no fit has to be repeated
    session.record("ann", measured(approve_open(session)))
    session.record("ann", measured(session.approve("ann", session.suggest("ann").number)))
    again = Session.open(former)
    assert [e.hash for e in again.entries] == [e.hash for e in session.entries]
    assert len(replay(again)) <= len(
        again.state.suggestions
    )  # on another computer they may come out otherwise


def test_one_that_cannot_be_written_is_only_looked_at(former: Path) -> None:
    session = Session.open(former, read_only=True)
    assert session.entries[-2].hash == HEADS[former.name]
    verify_session(session)
    assert [p.name for p in former.iterdir()] == [FILE_NAME]
    with pytest.raises(SessionError, match="cannot be written"):
        session.note("ann", "no")


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One whose last 24 entries are in the write-ahead log alone, as a killed program leaves them."""
    folder = tmp_path_factory.mktemp("killed")
    shutil.copytree(DATA / "box", folder / "work")
    database = sqlite3.connect(folder / "work" / FILE_NAME)
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA wal_autocheckpoint = 0")
    rows = database.execute("SELECT seq, line, hash FROM log ORDER BY seq").fetchall()
    database.execute("DROP TRIGGER log_stays")
    database.execute("DELETE FROM log WHERE seq > 3")
    database.execute(
        "CREATE TRIGGER log_stays BEFORE DELETE ON log BEGIN "
        "SELECT RAISE(ABORT, 'the log is append-only'); END"
    )
    database.commit()
    for row in rows[3:]:
        database.execute("INSERT INTO log VALUES (?, ?, ?)", row)
        database.commit()
    shutil.copytree(folder / "work", folder / "killed", ignore=shutil.ignore_patterns("*-shm"))
    database.close()
    return folder / "killed"


def test_what_a_killed_program_left_in_the_write_ahead_log_is_converted_or_said_to_be_damaged(
    killed: Path, tmp_path: Path
) -> None:
    """One flipped byte used to drop acknowledged entries in silence."""
    wal = (killed / f"{FILE_NAME}-wal").read_bytes()
    assert len(wal) > 24 * 4096
    rng = np.random.default_rng(0)
    noticed = 0
    for number in range(40):
        copy = Path(shutil.copytree(killed, tmp_path / f"copy{number}"))
        if number:
            bad = bytearray(wal)
            bad[rng.integers(len(bad))] ^= int(rng.integers(1, 256))
            (copy / f"{FILE_NAME}-wal").write_bytes(bytes(bad))
        try:
            session = Session.open(copy)
            assert (len(session.entries), session.entries[-2].hash) == (28, HEADS["box"])
        except AuditError:
            assert not (copy / "original" / "audit.log").exists()
            noticed += 1
    assert noticed > 25


@pytest.mark.parametrize("content", [b"", b"not a database", b"SQLite format 3\x00" + bytes(4000)])
def test_foreign_databases_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / FILE_NAME).write_bytes(content)
    with pytest.raises(SessionError, match=FILE_NAME):
        Session.open(tmp_path)


@pytest.fixture
def unread(former: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One whose database may neither be copied nor be opened by SQLite."""

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("read")

    monkeypatch.setattr(sqlite_format, "copy_sparse", refuse)
    monkeypatch.setattr(sqlite3, "connect", refuse)
    return former


@pytest.mark.parametrize("read_only", [False, True])
@pytest.mark.parametrize("size", [8 * 2**30, 2**40])
@pytest.mark.parametrize("begins", [b"", b"SQLite format 3\0", b"whole"])
def test_a_sparse_file_of_any_size_is_refused_by_its_header(
    unread: Path, begins: bytes, size: int, read_only: bool
) -> None:
    path = unread / FILE_NAME
    if begins != b"whole":
        path.write_bytes(begins)
    os.truncate(path, size)
    with pytest.raises(SessionError, match=FILE_NAME):
        Session.open(unread, read_only=read_only)
    assert path.stat().st_size == size


def test_a_header_that_claims_more_than_any_session_had_is_refused(unread: Path) -> None:
    path = unread / FILE_NAME
    with path.open("r+b") as file:
        file.seek(28)
        file.write((2**31).to_bytes(4))
    os.truncate(path, MAX_BYTES + 1)
    with pytest.raises(SessionError, match=f"expected at most {MAX_BYTES}"):
        Session.open(unread)


def _written(path: Path, place: int, content: bytes) -> None:
    with path.open("r+b") as file:
        file.seek(place)
        file.write(content)


def _all_that_is_there(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.rglob("*") if p.is_file() and p.name != "lock"}


@pytest.mark.parametrize(
    ("place", "content"),
    [
        (16, b"\x00\x03"),  # size of a page
        (18, b"\x01\x01"),  # no write-ahead log
        (21, b"\x00\x00\x00"),  # fractions that SQLite fixes
        (60, b"\x00\x00\x00\x02"),  # version of the tables
        (68, b"\x00\x00\x00\x00"),  # whose file it is
    ],
)
def test_beside_a_write_ahead_log_a_header_that_no_session_had_is_refused(
    killed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: int, content: bytes
) -> None:
    """It used to be copied first, which takes up to 8 GiB."""
    copy = Path(shutil.copytree(killed, tmp_path / "copy"))
    _written(copy / FILE_NAME, place, content)
    before = _all_that_is_there(copy)
    monkeypatch.setattr(sqlite_format, "copy_sparse", None)
    with pytest.raises(SessionError, match="no session of the former format"):
        Session.open(copy)
    assert _all_that_is_there(copy) == before


def test_a_copy_takes_no_more_of_the_disk_than_what_was_handed_in(
    killed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Header, tables, entries and write-ahead log are right; 8 GiB of pages that nothing uses are holes."""
    copy = Path(shutil.copytree(killed, tmp_path / "copy"))
    path = copy / FILE_NAME
    wal = path.with_name(f"{FILE_NAME}-wal")
    os.truncate(path, MAX_BYTES)
    _written(path, 28, (MAX_BYTES // 4096).to_bytes(4))
    taken = {}

    def look(source: Path, target: Path, size: int) -> None:
        copy_sparse(source, target, size)
        taken[target.name] = target.stat().st_blocks * 512

    monkeypatch.setattr(sqlite_format, "copy_sparse", look)
    Session.open(copy)
    assert set(taken) == {path.name, wal.name}
    assert sum(taken.values()) < 2**20


@pytest.mark.parametrize("end", ["-wal", "-shm", "-journal"])
@pytest.mark.parametrize("what", ["a pipe", "a directory", "a link to nothing", "a link to /dev/zero"])
def test_what_is_no_file_beside_the_database_holds_nobody(former: Path, end: str, what: str) -> None:
    """A write-ahead log is never passed over in silence: steps may be in it."""
    path = former / f"{FILE_NAME}{end}"
    {
        "a pipe": lambda: os.mkfifo(path),
        "a directory": path.mkdir,
        "a link to nothing": lambda: path.symlink_to(former / "nothing"),
        "a link to /dev/zero": lambda: path.symlink_to("/dev/zero"),
    }[what]()
    if end == "-wal":
        with pytest.raises(SessionError, match=f"{path.name}: is no regular file"):
            Session.open(former)
    else:
        assert Session.open(former).entries[-2].hash == HEADS[former.name]


def test_the_write_ahead_log_of_a_linked_database_lies_beside_the_database_itself(
    killed: Path, tmp_path: Path
) -> None:
    store = Path(shutil.copytree(killed, tmp_path / "store"))
    session = tmp_path / "session"
    session.mkdir()
    (session / FILE_NAME).symlink_to(store / FILE_NAME)
    assert Session.open(session).entries[-2].hash == HEADS["box"]
    assert (store / FILE_NAME).is_file()


def _changed(path: Path, *statements: tuple[str, tuple[object, ...]]) -> None:
    """Change a database behind the triggers that forbid it."""
    database = sqlite3.connect(path)
    triggers = database.execute("SELECT name, sql FROM sqlite_master WHERE type = 'trigger'").fetchall()
    for name, _ in triggers:
        database.execute(f"DROP TRIGGER {name}")
    for statement, values in statements:
        database.execute(statement, values)
    for _, sql in triggers:
        database.execute(sql)
    database.commit()
    database.close()


@pytest.mark.parametrize("known", ["x", -1, 0, 10**9, b"1", 1.5])
def test_cached_states_of_an_entry_that_is_none_are_left_behind(former: Path, known: object) -> None:
    _changed(former / FILE_NAME, ("UPDATE cache SET seq = ?", (known,)))
    session = Session.open(former)
    assert session.entries[-2].hash == HEADS[former.name]
    assert session.cache.read() is None


def test_a_row_longer_than_any_entry_is_refused_before_it_is_in_memory(
    former: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sqlite_format, "MAX_ENTRY_BYTES", 2**19)
    size = 2**20 + 1
    _changed(former / FILE_NAME, ("UPDATE log SET line = zeroblob(?) WHERE seq = 2", (size,)))
    with pytest.raises(AuditError, match="too big"):
        Session.open(former)


def test_more_entries_than_a_log_takes_are_refused(former: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sqlite_format, "MAX_LOG_BYTES", 5000)
    with pytest.raises(SessionError, match="more than 5000 bytes of entries"):
        Session.open(former)
    assert not (former / "original" / "audit.log").exists()


def test_huge_cached_states_are_left_behind(former: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sqlite_format, "MAX_CACHE_BYTES", 1000)
    session = Session.open(former)
    assert session.entries[-2].hash == HEADS[former.name]
    assert session.cache.read() is None


def test_a_write_ahead_log_larger_than_any_was_is_refused_unread(unread: Path) -> None:
    wal = unread / f"{FILE_NAME}-wal"
    wal.touch()
    os.truncate(wal, MAX_WAL_BYTES + 1)
    with pytest.raises(SessionError, match=f"{wal.name}.*expected at most {MAX_WAL_BYTES}"):
        Session.open(unread)


@pytest.mark.parametrize("page", [0, 2, 513, 3 * 2**9, 2**17, 2**32 - 1])
def test_a_write_ahead_log_whose_header_tells_no_page_size_is_damaged(former: Path, page: int) -> None:
    """The header has a valid checksum; a page of 4 GiB would be read into memory."""
    head = struct.pack(">6I", 0x377F0683, 3007000, page, 0, 1, 2)
    first = second = 0
    for a, b in struct.iter_unpack(">2I", head):
        first = (first + a + second) % 2**32
        second = (second + b + first) % 2**32
    (former / f"{FILE_NAME}-wal").write_bytes(head + struct.pack(">2I", first, second) + b"x" * 8000)
    with pytest.raises(AuditError, match="damaged"):
        Session.open(former)


def test_the_database_is_read_where_its_folder_has_any_name(former: Path) -> None:
    """Its address is one in which some signs mean something else."""
    odd = former.rename(former.with_name("a?mode=rw#b%41 \N{LATIN SMALL LETTER E WITH ACUTE}"))
    assert Session.open(odd).entries[-2].hash == HEADS[former.name]


def test_a_view_in_the_place_of_the_log_is_not_computed(tmp_path: Path) -> None:
    database = sqlite3.connect(tmp_path / FILE_NAME)
    database.executescript(
        "PRAGMA application_id = 1212437314; PRAGMA user_version = 1;"
        "CREATE VIEW log AS WITH RECURSIVE n(seq) AS (SELECT 1 UNION ALL SELECT seq + 1 FROM n) "
        "SELECT seq, CAST('x' AS BLOB) AS line, 'x' AS hash FROM n;"
    )
    database.close()
    with pytest.raises(SessionError, match="no session of the former format"):
        Session.open(tmp_path)


def test_a_changed_entry_is_named(former: Path) -> None:
    database = sqlite3.connect(former / FILE_NAME)
    trigger = database.execute("SELECT sql FROM sqlite_master WHERE name = 'log_keeps'").fetchone()[0]
    database.execute("DROP TRIGGER log_keeps")
    line = database.execute("SELECT line FROM log WHERE seq = 3").fetchone()[0]
    database.execute("UPDATE log SET line = ? WHERE seq = 3", (line.replace(b"ann", b"bob"),))
    database.execute(trigger)
    database.commit()
    database.close()
    with pytest.raises(AuditError, match="entry 3: was changed"):
        Session.open(former)
