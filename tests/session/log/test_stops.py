"""STOP: obeyed at once, whatever is said, whoever holds the log, and never lost."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hdsafebo.session.errors import ProtocolError, SessionError, StoppedError
from hdsafebo.session.log.stops import PREFIX, pending, press
from hdsafebo.session.log.store import MovedOnError, Store, utc_now
from hdsafebo.session.session import Session
from hdsafebo.session.views.audit import verify_session
from tests.session.small import approve_open, measured

Make = Callable[..., Session]


@pytest.mark.parametrize("who", ["", "  ", "x" * 101, "a\x00b", "a\u202eb", "\ud800", None, 7, ["x"]])
@pytest.mark.parametrize("reason", ["", "y" * 5000, "a\x00b\x9b", "\ud800", None, {"a": 1}])
def test_no_text_is_refused(make_session: Make, who: object, reason: object) -> None:
    session = make_session()
    assert session.stop(who, reason)  # type: ignore[arg-type]
    assert session.stopped
    stopped = session.entries[-1]
    assert stopped.kind == "stopped"
    assert stopped.who
    assert len(stopped.who) <= 100
    verify_session(Session.open(session.store.directory))


def test_a_stop_is_obeyed_while_another_program_holds_the_log(make_session: Make) -> None:
    session, other = make_session(), None
    session.suggest("ann")
    with (session.store.directory / "lock").open("r+b") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert not session.stop("ann", "it hurts")  # not in the log yet, and obeyed
        assert session.stopped == "it hurts"
        other = Session.open(session.store.directory)
        assert other.stopped == "it hurts"
        for step in (
            lambda: other.approve("bob", 1),
            lambda: other.manual("bob", {"values": [0.5, 0.5, 0.0]}),
            lambda: other.resume("bob"),
        ):
            with pytest.raises(StoppedError, match="it hurts"):
                step()
    with pytest.raises(ProtocolError, match="stopped"):
        other.approve("bob", 1)
    assert [e.kind for e in other.entries] == ["created", "suggested", "stopped"]
    assert (other.entries[-1].who, other.entries[-1].payload["reason"]) == ("ann", "it hurts")
    assert pending(session.store.directory) == []
    other.resume("bob")
    other.approve("bob", other.suggest("bob").number)


def test_a_stop_while_a_trial_is_being_approved_says_that_it_must_not_be_delivered(
    make_session: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = make_session()
    session.suggest("ann")
    append = Store.append

    def append_and_stop(store: Store, *arguments: object) -> None:
        append(store, *arguments)  # type: ignore[arg-type]
        if arguments[2] == "approved":
            press(store.directory, "bob", "now", utc_now())

    monkeypatch.setattr(Store, "append", append_and_stop)
    with pytest.raises(StoppedError, match="do not deliver trial 9"):
        approve_open(session)
    assert session.stopped == "now"
    session.not_delivered("ann", "stopped")
    session.resume("ann")
    assert session.suggest("ann").number == 2


def test_a_stop_that_comes_before_the_step_keeps_it_out_of_the_log(
    make_session: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = make_session()
    session.suggest("ann")
    append = Store.append

    def stop_and_append(store: Store, *arguments: object) -> None:
        press(store.directory, "bob", "now", utc_now())
        append(store, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(Store, "append", stop_and_append)
    with pytest.raises(ProtocolError, match="stopped meanwhile"):
        approve_open(session)
    assert session.state.running is None


def test_the_record_of_what_runs_is_taken_while_a_stop_waits(make_session: Make) -> None:
    session = make_session()
    session.suggest("ann")
    trial = approve_open(session)
    press(session.store.directory, "bob", "now", utc_now())
    assert session.record("ann", measured(trial)).status == "completed"
    assert [e.kind for e in session.entries[-2:]] == ["stopped", "recorded"]


def test_a_stop_with_spoilt_words_is_a_stop(make_session: Make) -> None:
    session = make_session()
    for number, content in enumerate((b"", b"x", bytes(100), b'{"who": 1}')):
        (session.store.directory / f"{PREFIX}{number}").write_bytes(content)
        session.refresh()
        assert session.stopped == "stop (its words were damaged)"
        session.resume("ann")


def test_a_pipe_in_the_place_of_a_stop_is_a_stop(make_session: Make) -> None:
    session = make_session()
    os.mkfifo(session.store.directory / f"{PREFIX}pipe")
    assert pending(session.store.directory)[0].reason == "stop (its words were damaged)"


@pytest.mark.parametrize("number", [errno.EACCES, errno.EMFILE, errno.EIO])
def test_nothing_starts_where_nobody_can_see_whether_a_stop_waits(
    make_session: Make, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    session = make_session()
    session.suggest("ann")
    press(session.store.directory, "bob", "now", utc_now())

    def unlistable(*arguments: object) -> list[str]:
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patch:
        patch.setattr(os, "listdir", unlistable)
        for step in (
            lambda: approve_open(session),
            lambda: session.manual("ann", {"values": [0.5, 0.5, 0.0]}),
            lambda: session.suggest("ann"),
        ):
            with pytest.raises(SessionError, match="whether the session was stopped cannot be seen"):
                step()
    assert [e.kind for e in session.entries] == ["created", "suggested"]
    session.refresh()
    assert session.stopped == "now"


def test_a_backup_takes_a_stop_with_it_that_waits_for_the_log(make_session: Make, tmp_path: Path) -> None:
    session = make_session()
    with (session.store.directory / "lock").open("r+b") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert not session.stop("bob", "it hurts")
        session.store.back_up(tmp_path / "backup")
    copy = Session.open(tmp_path / "backup")
    assert (copy.entries[-1].who, copy.stopped) == ("bob", "it hurts")
    session.refresh()
    assert copy.entries[-1].payload["pressed"] == session.entries[-1].payload["pressed"]
    verify_session(copy)


def test_a_full_disk_stops_none_the_less(make_session: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    session = make_session()

    def full(*arguments: object) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        for name in ("write", "pwrite"):
            patch.setattr(os, name, full)
        assert not session.stop("ann", "it hurts")
        assert session.stopped is not None
        with pytest.raises(StoppedError):
            session.manual("ann", {"values": [0.5, 0.5, 0.0]})
    session.refresh()
    assert session.entries[-1].kind == "stopped"


def test_many_stops_are_resumed_once(make_session: Make) -> None:
    session = make_session()
    for number in range(5):
        session.stop(f"p{number}", "again")
    assert [e.who for e in session.entries if e.kind == "stopped"] == [f"p{n}" for n in range(5)]
    session.resume("ann")
    assert session.stopped is None


def test_where_no_session_is_nothing_can_be_stopped(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="the stop cannot be kept"):
        press(tmp_path / "none", "ann", "now", utc_now())


@pytest.mark.parametrize("start", ["approve", "manual"])
@pytest.mark.parametrize("moment", ["after the entry", "before the log is read"])
def test_a_stop_that_others_wrote_into_the_log_at_once_keeps_a_trial_from_being_delivered(
    make_session: Make, monkeypatch: pytest.MonkeyPatch, start: str, moment: str
) -> None:
    """It does not wait any more when the step looks for it, so it has to be found in the log."""
    session = make_session()
    session.suggest("ann")
    other = Session.open(session.store.directory)
    append, read = session.store.append, session.store.read
    moments: list[str] = []

    def stop_at(now: str) -> None:
        if now == moment and moments.count(now) == 0:
            moments.append(now)
            assert other.stop("bob", "now"), "the stop is in the log"

    def append_and_stop(*arguments: Any) -> None:
        append(*arguments)
        stop_at("after the entry")
        monkeypatch.setattr(session.store, "read", stop_and_read)

    def stop_and_read() -> Any:
        stop_at("before the log is read")
        return read()

    monkeypatch.setattr(session.store, "append", append_and_stop)
    steps = {
        "approve": lambda: approve_open(session),
        "manual": lambda: session.manual("ann", {"values": [0.5, 0.5, 0.0]}),
    }
    with pytest.raises(StoppedError, match="do not deliver trial 9"):
        steps[start]()
    assert moments == [moment]
    assert session.stopped == "now"


def test_nobody_goes_on_over_a_stop_that_he_has_not_seen(make_session: Make) -> None:
    session = make_session()
    other = Session.open(session.store.directory)
    session.stop("ann", "a break")
    other.stop("bob", "it hurts")
    with pytest.raises(ProtocolError, match=r"stopped again meanwhile \(it hurts\)"):
        session.resume("ann")
    assert session.stopped == "it hurts"
    press(session.store.directory, "bob", "still", utc_now())  # this one waits for its place in the log
    with pytest.raises(ProtocolError, match=r"stopped again meanwhile \(still\)"):
        session.resume("ann")
    session.resume("ann")
    assert session.stopped is None


def test_a_stop_is_obeyed_before_its_words_are_written_and_keeps_them(
    make_session: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Others took it into the log at once, and with it words that were not there yet."""
    session = make_session()
    other = Session.open(session.store.directory)
    write, looks = os.write, []

    def write_while_others_look(file: int, data: bytes) -> int:
        other.refresh()
        looks.append(other.stopped)
        with pytest.raises(ProtocolError):
            other.manual("bob", {"values": [0.5, 0.5, 0.0]})
        done = write(file, data[: len(data) // 2])
        other.refresh()
        return done + write(file, data[len(data) // 2 :])

    monkeypatch.setattr(os, "write", write_while_others_look)
    stop = press(session.store.directory, "ann", "it hurts", utc_now())
    assert len(looks) == 1
    assert looks[0] is not None
    session.refresh()
    entry = session.entries[-1]
    assert (entry.kind, entry.who, entry.payload["reason"]) == ("stopped", "ann", "it hurts")
    assert entry.payload["pressed"] == stop.token
    assert [e.kind for e in session.entries].count("stopped") == 1


def test_a_step_is_refused_where_the_log_is_not_as_it_was_seen(make_session: Make) -> None:
    session = make_session()
    seen = session.entries[-1].hash
    Session.open(session.store.directory).note("bob", "meanwhile")
    steps = (
        lambda: session.suggest("ann"),
        lambda: session.manual("ann", {"values": [0.5, 0.5, 0.0]}),
        lambda: session.switch_target("ann", "economy"),
        lambda: session.note("ann", "x"),
    )
    with session.seen_at(seen):
        for step in steps:
            with pytest.raises(MovedOnError, match="has moved on"):
                step()
    assert [e.kind for e in session.entries] == ["created", "noted"]
    session.note("ann", "x")


@pytest.mark.parametrize("name", [b"STOP-\xff\xfe", b"STOP-" + b"\xff" * 200, "STOP-\u202e\n".encode()])
def test_a_stop_is_obeyed_whatever_its_file_is_called(
    make_session: Make, tmp_path: Path, name: bytes
) -> None:
    """A name that is no UTF-8 could not be written into the log, and the session not be opened again."""
    session = make_session()
    Path(os.fsdecode(os.fsencode(session.store.directory) + b"/" + name)).touch()
    session.store.back_up(tmp_path / "copy")
    for directory in (session.store.directory, tmp_path / "copy"):
        opened = Session.open(directory)
        assert opened.stopped
        opened.resume("ann")
        assert Session.open(directory).stopped is None
        verify_session(Session.open(directory))


@pytest.mark.parametrize(
    "words",
    [
        {"who": 5, "reason": "r", "time": "t"},
        {"who": "a" * 300, "reason": "r" * 3000, "time": "t" * 3000},
        {"who": "a", "reason": None, "time": None},
        {"who": "\ud800", "reason": "\u202e", "time": "\ud800"},
        {"who": "", "reason": "", "time": []},
    ],
)
def test_a_stop_that_others_wrote_can_be_resumed(make_session: Make, words: dict[str, Any]) -> None:
    """Words that no log can hold waited for ever, and nobody could resume; with no reason none was shown."""
    session = make_session()
    text = json.dumps(words).encode()
    content = hashlib.sha256(text).hexdigest().encode() + b" " + text
    (session.store.directory / f"{PREFIX}x").write_bytes(content)
    session.refresh()
    assert session.stopped
    assert pending(session.store.directory) == []
    session.resume("ann")
    verify_session(Session.open(session.store.directory))


def test_what_keeps_a_session_stopped_is_named(make_session: Make) -> None:
    session = make_session()
    (session.store.directory / f"{PREFIX}folder").mkdir()  # nobody but its owner removes it
    session.refresh()
    with pytest.raises(StoppedError, match=f"{PREFIX}folder removed from {session.store.directory}"):
        session.resume("ann")
