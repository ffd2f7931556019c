"""The documentation has a page for every method, and its code runs."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from hdsafebo.optimizers.registry import METHODS


def test_every_method_is_on_a_page(project_root: Path) -> None:
    pages = "".join(page.read_text() for page in (project_root / "docs" / "methods").glob("*.md"))
    for method in METHODS.values():
        assert f"hdsafebo.optimizers.{method.module}.{method.kind}\n" in pages, method


def test_every_page_is_in_the_navigation(project_root: Path) -> None:
    navigation = (project_root / "mkdocs.yml").read_text()
    for page in (project_root / "docs").rglob("*.md"):
        assert page.relative_to(project_root / "docs").as_posix() in navigation


def test_the_code_of_the_methods_page_runs(project_root: Path) -> None:
    text = (project_root / "docs" / "methods" / "index.md").read_text(encoding="utf-8")
    examples = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert examples
    for example in examples:
        done = subprocess.run([sys.executable, "-W", "error", "-c", example], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
