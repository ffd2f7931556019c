"""The README's examples run as they stand."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize(("number", "file"), [(0, "polisher.hdsafebo/state"), (1, "hopper.safetensors")])
def test_the_examples_run(project_root: Path, tmp_path: Path, number: int, file: str) -> None:
    text = (project_root / "README.md").read_text(encoding="utf-8")
    examples = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert len(examples) == 2
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", examples[number]],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(project_root / "src")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert (tmp_path / file).exists()
    assert "None" not in result.stdout


def test_every_linked_file_exists(project_root: Path) -> None:
    text = (project_root / "README.md").read_text(encoding="utf-8")
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", text):
        assert (project_root / target).exists(), target


def test_every_make_target_is_real(project_root: Path) -> None:
    targets = set(re.findall(r"^([a-z-]+):", (project_root / "Makefile").read_text(), flags=re.MULTILINE))
    named = set(re.findall(r"make ([a-z-]+)", (project_root / "README.md").read_text()))
    assert named - {"and"} <= targets
