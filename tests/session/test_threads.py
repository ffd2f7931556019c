"""The same suggestions with any number of threads."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import write_mapping
from hdsafebo.session.create import create_session
from hdsafebo.session.session import Session
from tests.session.small import approve_open, box_definition, measured, write_box_files

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


def followed(session: Session, trials: int) -> None:
    """Suggest, approve and record."""
    for _ in range(trials):
        session.suggest("ann")
        session.record("ann", measured(approve_open(session)))


def require_the_same(
    session: Session, trials: int, project_root: Path, numbers: tuple[str, ...] = ("1", "2", "4")
) -> None:
    """Compute all suggestions again, in processes with these numbers of threads."""
    for threads in numbers:
        environment = os.environ | dict.fromkeys(_VARIABLES, threads)
        environment["PYTHONPATH"] = str(project_root / "src")
        command = [sys.executable, "-c", _REPLAY, str(session.store.directory)]
        made = subprocess.run(
            command, env=environment, capture_output=True, text=True, check=True, timeout=300
        )
        assert made.stdout.split() == [str(trials), "0"], f"with {threads} threads"


@pytest.mark.parametrize("kind", ["box", "list"])
def test_suggestions_come_out_again_with_another_number_of_threads(
    make_session: Make, kind: str, project_root: Path
) -> None:
    method = {"name": "hdsafebo_shortlist"} if kind == "list" else {"name": "hdsafebo_local"}
    session = make_session(kind, method=method)
    followed(session, 8)
    require_the_same(session, 8, project_root)


def test_a_method_that_computes_with_torch_keeps_to_one_thread_as_well(
    tmp_path: Path, project_root: Path
) -> None:
    """It loads torch only when it proposes, and torch counts its own threads. Its sums depend on them."""
    definition, initial = write_box_files(tmp_path / "files", n=300)
    inputs = [{"name": name, "lower": -1.0, "upper": 1.0} for name in "abc"]
    data = box_definition() | {"inputs": inputs, "method": {"name": "cei"}}
    write_mapping(definition, data, ParamsError)
    session = create_session(tmp_path / "s", definition, who="ann", initial=initial)
    followed(session, 2)
    require_the_same(session, 2, project_root, ("4",))
