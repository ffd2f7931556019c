"""Profiles rewrite params.yaml, but never an edited one in silence."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from hdsafebo.errors import ParamsError, UnknownNameError
from hdsafebo.files.yaml import read_mapping
from hdsafebo.pipeline.profiles import apply_profile, profile_text


@pytest.fixture
def copy(project_root: Path, tmp_path: Path) -> Path:
    shutil.copytree(project_root / "profiles", tmp_path / "profiles")
    return tmp_path


def test_committed_params_are_the_standard_profile(project_root: Path) -> None:
    """A checkout in which another profile was applied is not what gets committed."""
    import subprocess

    committed = subprocess.run(
        ["git", "show", "HEAD:params.yaml"], cwd=project_root, capture_output=True, text=True, check=False
    )
    if committed.returncode:
        pytest.skip("not a git checkout")
    assert committed.stdout == profile_text(project_root, "standard")


def test_applying_twice_changes_nothing(copy: Path) -> None:
    assert apply_profile(copy, "smoke")
    assert not apply_profile(copy, "smoke")
    assert read_mapping(copy / "params.yaml", ParamsError)["profile"] == "smoke"
    assert apply_profile(copy, "standard")


def test_an_edited_file_is_kept_unless_forced(copy: Path) -> None:
    apply_profile(copy, "standard")
    path = copy / "params.yaml"
    path.write_text(path.read_text().replace("batch: 10", "batch: 7"))
    with pytest.raises(ParamsError, match="--force"):
        apply_profile(copy, "smoke")
    assert "batch: 7" in path.read_text()
    assert apply_profile(copy, "smoke", force=True)


def test_unknown_profile_lists_the_names(copy: Path) -> None:
    with pytest.raises(UnknownNameError, match="paper, reference, smoke, standard"):
        apply_profile(copy, "huge")
