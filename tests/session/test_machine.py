"""Random steps of two people with pauses, late records, stops, kills and reopening.

No limit is broken by any trial that starts, as an account of its own shows; nothing acknowledged is lost;
every suggestion comes out again, to the bit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import write_mapping
from hdsafebo.session.errors import SessionError
from hdsafebo.session.log.chain import Entry
from hdsafebo.session.log.stops import press
from hdsafebo.session.log.store import utc_now
from hdsafebo.session.session import Session
from hdsafebo.session.views.audit import replay, verify_session
from tests.session.faults import Killed, failing
from tests.session.small import bowl, measured

Make = Callable[..., Session]
_KINDS = ("suggested", "approved", "modified", "manual")
_METHOD = {"name": "hdsafebo_local", "settings": {"alpha": 0.99, "max_fitted_trials": 40}}


class Machine:
    """Two open views of one session, and what they were told."""

    def __init__(self, session: Session, files: Path, seed: int, patch: pytest.MonkeyPatch) -> None:
        self.directory = session.store.directory
        self.files = files
        self.rng = np.random.default_rng(seed)
        self.patch = patch
        self.views = [session, Session.open(self.directory)]
        self.acknowledged: list[str] = []
        self.stops = 0
        self.done: Counter[str] = Counter()

    def run(self, steps: int) -> None:
        """Take random steps."""
        for _ in range(steps):
            which = int(self.rng.integers(2))
            name = str(self.rng.choice(list(_STEPS), p=_SHARES))
            try:
                if self.rng.random() < 0.7:  # otherwise this person has not seen what the other one did
                    self.views[which].refresh()
                if self.rng.random() < 0.1:
                    with failing(self.patch, int(self.rng.integers(1, 7)), Killed()):
                        _STEPS[name](self, self.views[which])
                else:
                    _STEPS[name](self, self.views[which])
            except Killed:
                self.done["killed"] += 1
                self.views[which] = Session.open(self.directory)
                continue
            except (SessionError, IndexError):
                self.done["refused"] += 1
                continue
            self.done[name] += 1
            if name != "press":
                self.acknowledged.append(self.views[which].entries[-1].hash)

    # --- steps

    def suggest(self, view: Session) -> None:
        view.suggest("ann")

    def approve(self, view: Session) -> None:
        view.approve("ann", view.state.suggestions[-1].number)

    def modify(self, view: Session) -> None:
        view.modify("bob", self.point(), "otherwise", view.state.suggestions[-1].number)

    def refuse(self, view: Session) -> None:
        view.refuse("bob", "no", view.state.suggestions[-1].number)

    def manual(self, view: Session) -> None:
        view.manual("bob", self.point())

    def record(self, view: Session) -> None:
        view.record("ann", measured(view.state.trials[-1]), view.state.trials[-1].number)

    def not_delivered(self, view: Session) -> None:
        view.not_delivered("ann", "cable", view.state.trials[-1].number)

    def stop(self, view: Session) -> None:
        view.stop("", "")
        self.stops += 1

    def press(self, view: Session) -> None:
        press(self.directory, "bob", "now", utc_now())
        self.stops += 1

    def resume(self, view: Session) -> None:
        view.resume("ann")

    def switch(self, view: Session) -> None:
        view.switch_target("ann", str(self.rng.choice(["speed", "economy"])))

    def note(self, view: Session) -> None:
        view.note("ann", "coffee")

    def reopen(self, view: Session) -> None:
        self.views[self.views.index(view)] = Session.open(self.directory)

    def tighten(self, view: Session) -> None:
        path = self.files / "tight.yaml"
        definition: dict[str, Any] = dict(view.state.definition)
        limits = definition["inputs"][0]
        if limits["max_step"] > 0.25:
            inputs = [limits | {"max_step": limits["max_step"] - 0.01}, *definition["inputs"][1:]]
            write_mapping(path, definition | {"inputs": inputs}, ParamsError)
            view.tighten("ann", path)

    def point(self) -> dict[str, list[float]]:
        return {"values": self.rng.uniform([0.1, 0.1, -0.8], [1.0, 0.9, 0.8]).round(3).tolist()}


_STEPS: dict[str, Callable[[Machine, Session], None]] = {
    "suggest": Machine.suggest,
    "approve": Machine.approve,
    "modify": Machine.modify,
    "refuse": Machine.refuse,
    "manual": Machine.manual,
    "record": Machine.record,
    "not_delivered": Machine.not_delivered,
    "stop": Machine.stop,
    "press": Machine.press,
    "resume": Machine.resume,
    "switch": Machine.switch,
    "note": Machine.note,
    "reopen": Machine.reopen,
    "tighten": Machine.tighten,
}
_WEIGHTS = np.array([22, 20, 4, 2, 6, 22, 2, 1.5, 1, 14, 2, 3, 3, 1.5], float)
_SHARES = _WEIGHTS / _WEIGHTS.sum()


def limits_broken(entries: list[Entry]) -> int:
    """Trials outside the limits that held when they started, by an account that shares no code with sessions.

    A trial's inputs lie within `lower` and `upper`, and at most `max_step` from those of the trial that was
    delivered last, or from `home` when there was none since a start, a stop or tighter limits.
    """
    inputs = entries[0].payload["definition"]["inputs"]
    last: list[float] | None = None
    running: list[float] = []
    suggested: list[float] = []
    stopped = interrupted = False
    broken = 0
    for entry in entries:
        p = entry.payload
        if entry.kind == "suggested":
            suggested = p["point"]["values"]
        elif entry.kind in ("approved", "modified", "manual"):
            running = suggested if entry.kind == "approved" else p["point"]["values"]
            interrupted = False
            start = last or [i["home"] for i in inputs]
            inside = all(
                i["lower"] - 1e-8 <= v <= i["upper"] + 1e-8 and abs(v - s) <= i["max_step"] + 1e-8
                for i, v, s in zip(inputs, running, start, strict=True)
            )
            broken += stopped or not inside
        elif entry.kind == "recorded":
            if p["delivered"] and not interrupted:
                last = running
        elif entry.kind == "stopped":
            stopped, interrupted, last = True, True, None
        elif entry.kind == "resumed":
            stopped = False
        elif entry.kind == "tightened":
            inputs, last = p["definition"]["inputs"], None
    return broken


def drive(session: Session, files: Path, steps: int, seed: int, patch: pytest.MonkeyPatch) -> Counter[str]:
    """Take random steps, then compare log, acknowledgements, limits and suggestions."""
    machine = Machine(session, files, seed, patch)
    machine.run(steps)
    final = Session.open(machine.directory)
    verify_session(final)
    hashes = [e.hash for e in final.entries]
    assert set(machine.acknowledged) <= set(hashes)
    assert sum(e.kind == "stopped" for e in final.entries) >= machine.stops
    assert limits_broken(list(final.entries)) == 0
    assert replay(final) == []
    for view in machine.views:
        view.refresh()
        assert [e.hash for e in view.entries] == hashes
        assert view.state == final.state
    return machine.done


def test_the_account_of_limits_finds_what_is_broken(make_session: Make) -> None:
    session = make_session()
    trial = session.manual("ann", {"values": [0.8, 0.5, 0.0]})
    session.stop("ann", "pause")
    session.resume("ann")
    session.record("ann", measured(trial))
    assert limits_broken(list(session.entries)) == 0
    session.store.append(
        session.state.head, "eve", "manual", {"point": {"values": [0.9, 0.5, 0.0]}, "reason": ""}
    )
    session.refresh()
    assert limits_broken(list(session.entries)) == 1
    assert bowl([0.5, 0.5, 0.0])["margin"] > 0


def test_random_steps(make_session: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = drive(make_session(method=_METHOD), tmp_path / "s-files", 250, 0, monkeypatch)
    assert min(done[name] for name in ("suggest", "approve", "record", "resume", "reopen", "killed")) >= 3


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("seed", range(1, 6))
def test_ten_thousand_random_steps(
    make_session: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """2,000 in each of five sessions."""
    done = drive(make_session(method=_METHOD), tmp_path / "s-files", 2000, seed, monkeypatch)
    assert min(done[name] for name in ("suggest", "approve", "record", "tighten", "killed")) >= 10
