"""What DVC itself does with a stage: experiments in the workspace and in a copy, no git, a single stage."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import read_mapping

STAGE = """
from pathlib import Path
from hdsafebo.pipeline.store import home_of

home = home_of(Path.cwd())
(home / ".journal").mkdir(exist_ok=True)
with (home / ".journal" / "log").open("a") as log:
    log.write(f"{Path.cwd()}\\n")
Path("a.txt").write_text(Path("params.yaml").read_text())
"""
DVC_FILE = """
stages:
  a: {cmd: python stage.py, deps: [stage.py], params: [x], outs: [a.txt]}
  b: {cmd: cp a.txt b.txt, deps: [a.txt], outs: [b.txt]}
"""
NAMES = {f"GIT_{who}_{what}": "a@b" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}


def run(folder: Path, *command: str, code: int = 0) -> str:
    """What a command printed."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | NAMES | {"DVC_NO_ANALYTICS": "1", "PATH": path}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture
def project(tmp_path: Path, project_root: Path) -> Path:
    (tmp_path / ".dvc").mkdir()
    (tmp_path / ".dvc/config").write_text((project_root / ".dvc/config").read_text())
    files = {
        "stage.py": STAGE,
        "dvc.yaml": DVC_FILE,
        "params.yaml": "x: 1\n",
        ".gitignore": "/.journal/\n/a.txt\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_experiments_keep_their_journal_in_the_project(project: Path) -> None:
    run(project, "git", "init", "--quiet")
    run(project, "git", "add", ".")
    run(project, "git", "commit", "--quiet", "--message", "start")
    run(project, "dvc", "exp", "run", "--set-param", "x=0.00001", "a")
    assert read_mapping(project / "a.txt", ParamsError) == {"x": 1e-05}
    output = run(project, "dvc", "exp", "run", "--temp", "--set-param", "x=3", "a")
    assert "Ran experiment" in output
    workspace, copy = (project / ".journal/log").read_text().splitlines()
    assert Path(workspace) == project
    assert Path(copy).is_relative_to(project / ".dvc/tmp")
    assert not Path(copy).exists()


def test_a_folder_without_git_and_a_stage_whose_input_is_missing(project: Path) -> None:
    assert "is not a git repository" in run(project, "dvc", "repro", code=255)
    run(project, "dvc", "config", "--local", "core.no_scm", "true")  # as `make repro` does
    assert "a.txt" in run(project, "dvc", "repro", "--single-item", "b", code=255)
    run(project, "dvc", "repro")
    assert (project / "b.txt").read_text() == "x: 1\n"
