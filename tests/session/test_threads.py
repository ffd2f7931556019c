"""The same suggestions with any number of threads."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from hdsafebo.session.session import Session
from tests.session.small import approve_open, measured

Make = Callable[..., Session]
_REPLAY = """
import sys
from pathlib import Path
from hdsafebo.session.session import Session
from hdsafebo.session.views.audit import replay
session = Session.open(Path(sys.argv[1]), read_only=True)
print(len(session.state.suggestions), len(replay(session)))
"""
_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@pytest.mark.parametrize("kind", ["box", "list"])
def test_suggestions_come_out_again_with_another_number_of_threads(
    make_session: Make, kind: str, project_root: Path
) -> None:
    method = {"name": "hdsafebo_shortlist"} if kind == "list" else {"name": "hdsafebo_local"}
    session = make_session(kind, method=method)
    for _ in range(8):
        session.suggest("ann")
        session.record("ann", measured(approve_open(session)))
    for threads in ("1", "2", "4"):
        environment = os.environ | dict.fromkeys(_VARIABLES, threads)
        environment["PYTHONPATH"] = str(project_root / "src")
        command = [sys.executable, "-c", _REPLAY, str(session.store.directory)]
        made = subprocess.run(
            command, env=environment, capture_output=True, text=True, check=True, timeout=300
        )
        assert made.stdout.split() == ["8", "0"], f"with {threads} threads"
