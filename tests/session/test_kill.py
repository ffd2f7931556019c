"""SIGKILL at random moments: nothing acknowledged is lost, no suggestion is orphaned, replay agrees."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from hdsafebo.session.session import Session
from hdsafebo.session.views.audit import replay, verify_session

Make = Callable[..., Session]


def kill_again_and_again(session: Session, root: Path, kills: int, seed: int) -> None:
    """Start the working process and kill it, `kills` times; then compare log and acknowledgements."""
    directory = session.store.directory
    acknowledged = directory.parent / "acknowledged"
    acknowledged.touch()
    random_moment = random.Random(seed)
    environment = os.environ | {"PYTHONPATH": f"{root}{os.pathsep}{root / 'src'}", "OMP_NUM_THREADS": "1"}
    for _ in range(kills):
        lines = acknowledged.read_text().count("\n")
        wanted = (
            lines + 1 + random_moment.randrange(4)
        )  # opened, and up to three steps: a busy machine is slow
        command = [sys.executable, "-m", "tests.session.killing", str(directory), str(acknowledged)]
        process = subprocess.Popen(command, cwd=root, env=environment, start_new_session=True)
        while acknowledged.read_text().count("\n") < wanted:
            assert process.poll() is None, "the working process ended by itself"
            time.sleep(0.01)
        time.sleep(random_moment.uniform(0.0, 0.3))
        assert process.poll() is None, "the working process ended by itself"
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    session.refresh()
    _nothing_is_lost(session, acknowledged.read_text().split("\n")[:-1])
    verify_session(session)
    assert replay(session) == []


def _nothing_is_lost(session: Session, acknowledged: list[str]) -> None:
    logged = Counter()
    suggestion = trial = 0
    trials_before = sum(t.origin == "initial" for t in session.state.trials)
    for entry in session.entries:
        if entry.kind == "suggested":
            suggestion += 1
            logged[f"suggested {suggestion}"] += 1
        elif entry.kind in ("approved", "refused"):
            logged[f"{entry.kind} {entry.payload['suggestion']}"] += 1
        elif entry.kind == "recorded":
            trial += 1
            logged[f"recorded {entry.payload['trial']}"] += 1
    assert set(logged.values()) <= {1}
    said = {line for line in acknowledged if line != "open"}
    assert said <= set(logged)
    assert trial > 0
    assert len(session.state.trials) - trials_before - trial in (0, 1)
    decided = [s for s in session.state.suggestions if s.decision in ("approved", "refused")]
    assert len(session.state.suggestions) - len(decided) in (0, 1)  # only the last may still be open


def test_killed_five_times(make_session: Make, project_root: Path) -> None:
    kill_again_and_again(make_session(), project_root, kills=5, seed=0)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_killed_a_hundred_times(make_session: Make, project_root: Path) -> None:
    kill_again_and_again(make_session(), project_root, kills=100, seed=1)
