"""One session object used by several threads, and interrupted anywhere: memory and log stay one."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any

import numpy as np
import pytest

from hdsafebo.errors import HdSafeBOError
from hdsafebo.session.advice.advisor import Advisor
from hdsafebo.session.errors import StoppedError
from hdsafebo.session.session import Session
from hdsafebo.session.views.audit import replay, verify_session
from tests.session.small import measured

Make = Callable[..., Session]
HOME = {"values": [0.5, 0.5, 0.0]}
FREE = [{"name": n, "lower": -1.0, "upper": 1.0} for n in "abc"]

STEPS: dict[str, tuple[Callable[[Session], Any], Callable[[Session], Any]]] = {
    "note": (lambda s: None, lambda s: s.note("ann", "x")),
    "manual": (lambda s: None, lambda s: s.manual("ann", HOME)),
    "record": (lambda s: s.manual("ann", HOME), lambda s: s.record("ann", measured(s.state.trials[-1]))),
    "suggest": (lambda s: None, lambda s: s.suggest("ann")),
    "approve": (lambda s: s.suggest("ann"), lambda s: s.approve("ann", 1)),
    "refresh": (lambda s: Session.open(s.store.directory).note("bob", "y"), lambda s: s.refresh()),
}


CHANGING = ("session.py", "opened.py", "store.py", "layout.py", "rules.py", "advisor.py")


def lines_of(step: Callable[[], Any], interrupted_at: int = 0) -> int:
    """How many lines that change a session a step takes; at one of them Ctrl-C is pressed, 0 for none."""
    lines = 0

    def trace(frame: FrameType, event: str, argument: object) -> Any:
        nonlocal lines
        if not frame.f_code.co_filename.endswith(CHANGING) or "/session/" not in frame.f_code.co_filename:
            return None
        if event == "line":
            lines += 1
            if lines == interrupted_at:
                raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        step()
    finally:
        sys.settrace(before)
    return lines


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # a file that was just opened
@pytest.mark.parametrize("name", STEPS)
def test_a_step_interrupted_anywhere_leaves_memory_and_log_one(make_session: Make, name: str) -> None:
    """Ctrl-C in a notebook: the same object goes on, and what it appends follows from the log."""
    prepare, step = STEPS[name]
    session = make_session(name="counted")
    prepare(session)
    lines = lines_of(lambda: step(session))
    count = 3 if name in ("suggest", "approve") else 8
    for place in (
        np.linspace(lines // 3, lines, count).astype(int).tolist()
    ):  # before that nothing has changed
        session = make_session(name=f"s{place}")
        prepare(session)
        with pytest.raises(KeyboardInterrupt):
            lines_of(lambda s=session: step(s), place)  # type: ignore[misc]
        session.note("ann", "after it")
        other = Session.open(session.store.directory)
        verify_session(other)
        assert list(session.entries) == list(other.entries)
        assert session.state == other.state
        if name == "suggest":
            session.suggest("ann")
            assert replay(Session.open(session.store.directory)) == []


def test_an_interrupt_forgets_no_stop_that_was_not_seen(make_session: Make) -> None:
    """What is read anew after an interrupt has not been seen by the person."""
    session = make_session()
    session.stop("ann", "one")
    with pytest.raises(KeyboardInterrupt):
        lines_of(lambda: session.note("ann", "x"), 30)
    Session.open(session.store.directory).stop("bob", "two")
    with pytest.raises(HdSafeBOError, match="stopped again meanwhile"):
        session.resume("ann")
    session.resume("ann")


@pytest.fixture
def hasty() -> Any:
    """Threads take turns every few instructions."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(before)


def in_threads(count: int, work: Callable[[int], None]) -> list[BaseException]:
    """What the threads raise."""
    raised: list[BaseException] = []

    def run(number: int) -> None:
        try:
            work(number)
        except BaseException as error:
            raised.append(error)

    threads = [threading.Thread(target=run, args=(i,)) for i in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return raised


def test_eight_threads_of_one_session_take_turns(make_session: Make, hasty: Any) -> None:
    session = make_session()
    assert in_threads(8, lambda i: [session.note("ann", f"{i}, {k}") for k in range(5)] and None) == []
    assert [e.seq for e in session.entries] == list(range(1, 42))
    assert session.state == Session.open(session.store.directory).state


def test_robots_in_threads_of_their_own_share_one_session(make_session: Make, hasty: Any) -> None:
    session = make_session(inputs=FREE, at_once=3)
    done: list[int] = []

    def robot(number: int) -> None:
        for _ in range(50):  # another robot's result expires a suggestion that is still undecided
            try:
                trial = session.approve(f"robot {number}", session.suggest(f"robot {number}").number)
                break
            except HdSafeBOError:
                continue
        done.append(session.record(f"robot {number}", measured(trial), trial.number).number)

    assert in_threads(3, robot) == []
    assert len(set(done)) == 3
    again = Session.open(session.store.directory)
    verify_session(again)
    assert replay(again) == []


def test_a_stop_of_another_thread_does_not_wait_for_a_suggestion(
    make_session: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = make_session()
    computing, stopped = threading.Event(), threading.Event()
    advise = Advisor.advise

    def slowly(self: Advisor) -> Any:
        computing.set()
        assert stopped.wait(20)
        return advise(self)

    monkeypatch.setattr(Advisor, "advise", slowly)

    def stop(number: int) -> None:
        assert computing.wait(20)
        session.stop("bob", "at once")
        assert session.stopped == "at once"
        stopped.set()

    def suggest() -> None:
        with pytest.raises((StoppedError, HdSafeBOError), match="stop"):
            session.suggest("ann")

    assert in_threads(2, lambda i: suggest() if i else stop(i)) == []
    assert session.state.open_suggestion is None
