"""What the Makefile removes and installs."""

from __future__ import annotations

import fnmatch
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import read_mapping


@pytest.fixture
def copy(tmp_path: Path, project_root: Path) -> Path:
    for name in ("Makefile", "requirements.lock", "requirements-cuda.lock", "pyproject.toml"):
        shutil.copy(project_root / name, tmp_path / name)
    return tmp_path


def test_clean_removes_what_stages_write_and_no_more(copy: Path, project_root: Path) -> None:
    stages = read_mapping(project_root / "dvc.yaml", ParamsError)["stages"]
    outs = [out for stage in stages.values() for key in ("outs", "metrics") for out in stage.get(key, [])]
    made = [copy / re.sub(r"\$\{.*?\}", "x", out) for out in outs]
    tracked = subprocess.run(
        ["git", "-C", str(project_root), "ls-files", "data", "models", "reports"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if tracked.returncode:
        pytest.skip("not a git checkout")
    own = ["data/patient7/log/entries", "data/session.yaml", "models/mine.pt", "reports/notes.md"]
    kept = [copy / name for name in [*tracked.stdout.split(), *own, ".journal/rounds.log", "mlruns.db"]]
    for path in [*made, *kept]:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("content")
    subprocess.run(["make", "--silent", "clean"], cwd=copy, check=True)
    assert [path for path in made if path.exists()] == []
    assert [path for path in kept if not path.exists()] == []


def test_every_pin_of_the_lock_has_hashes(project_root: Path) -> None:
    for name in ("requirements.lock", "requirements-cuda.lock"):
        text = (project_root / name).read_text()
        pins = [line for line in text.splitlines() if line and line[0] not in "# "]
        assert len(pins) > 10
        for pin in pins:
            assert re.fullmatch(r"[A-Za-z0-9._-]+==\S+( ; .*)? \\", pin), pin
        assert text.count("--hash=sha256:") >= len(pins)
        assert text.count("\n    --hash=sha256:") == text.count("--hash=")


def test_what_the_project_needs_is_pinned(project_root: Path) -> None:
    """Every requirement of pyproject.toml, of the package and of its extras."""
    import tomllib

    project = tomllib.loads((project_root / "pyproject.toml").read_text())["project"]
    extras = [r for group in project["optional-dependencies"].values() for r in group]
    wanted = {re.split(r"[\[<>=]", r)[0] for r in [*project["dependencies"], *extras]} - {"hdsafebo"}
    pinned = re.findall(r"(?m)^([a-z0-9.-]+)==", (project_root / "requirements.lock").read_text())
    missing = {name for name in wanted if not fnmatch.filter(pinned, re.sub(r"[._]", "-", name).lower())}
    assert not missing
