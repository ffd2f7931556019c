"""A disk that is full or read-only, at every write point: a message with the path, and nothing lost."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.write_points import POINTS

NAMESPACE = ["unshare", "--map-root-user", "--mount"]  # in which anyone may mount a file system
REASON = {
    "full": r"No space left|disk is full|disk full",
    "read-only": r"Read-only|read-only",
    "limited": r"File too large|disk full",
}


def may_mount() -> bool:
    """Whether this machine lets its users have mount namespaces."""
    try:
        return subprocess.run([*NAMESPACE, "true"], capture_output=True, check=False).returncode == 0
    except OSError:
        return False


@pytest.fixture(scope="module")
def said(
    tmp_path_factory: pytest.TempPathFactory, project_root: Path
) -> dict[str, dict[str, dict[str, str]]]:
    """Fault -> write point -> error and message. Without a namespace, a limit of the process has to do."""
    path = os.pathsep.join([str(project_root), str(project_root / "src"), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", "tests.write_points", str(tmp_path_factory.mktemp("disks"))]
    command = [*NAMESPACE, *command, "full", "read-only"] if may_mount() else [*command, "limited"]
    environment = os.environ | {"PYTHONPATH": path}
    result = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert result.returncode == 0, f"something was lost, or did not go on:\n{result.stderr}"
    found: dict[str, dict[str, dict[str, str]]] = json.loads(result.stdout.splitlines()[-1])
    return found


@pytest.mark.parametrize("name", POINTS)
def test_a_write_point_says_what_is_wrong_and_where(
    said: dict[str, dict[str, dict[str, str]]], name: str
) -> None:
    """That it kept what was there and goes on when the disk is sound is asserted as it runs."""
    answers = {fault: points[name] for fault, points in said.items() if name in points}
    for fault, answer in answers.items():
        assert answer["error"] not in ("", "untyped"), answer
        assert POINTS[name].name in answer["message"]
        assert re.search(REASON[fault], answer["message"]), answer["message"]


def test_something_in_the_way_is_named(tmp_path: Path) -> None:
    """Where a directory is expected there is a file."""
    from hdsafebo.files.atomic import WriteError, replacing
    from hdsafebo.pipeline.profiles import apply_profile

    (tmp_path / "file").write_text("in the way")
    with (
        pytest.raises(WriteError, match=r"file/a\.txt: cannot be written"),
        replacing(tmp_path / "file" / "a.txt"),
    ):
        pass
    (tmp_path / "profiles").symlink_to(Path(__file__).parents[1] / "profiles")
    (tmp_path / "params.yaml").mkdir()
    with pytest.raises(WriteError, match=r"params\.yaml: cannot be written: Is a directory"):
        apply_profile(tmp_path, "smoke")
