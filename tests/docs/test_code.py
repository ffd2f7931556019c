"""Every block of code in README.md and the documentation runs, or could run, as it stands."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.docs.blocks import ALL, PAGES, Block, of
from tests.docs.shell import Refused, check
from tools.docs import tutorials

LANGUAGES = {"python", "sh", "yaml", "text"}
PYTHON = sorted({block.page for block in of("python")})
SHELL = sorted({block.page for block in of("sh")})
ELSEWHERE = ("docs/examples.md", "docs/tutorials/")
"""Run by tests of their own: `tests/test_examples.py`, and below."""


def test_every_block_says_its_language() -> None:
    assert ALL
    assert [(b.page, b.line) for b in ALL if b.language not in LANGUAGES] == []


@pytest.mark.parametrize("page", [p for p in PYTHON if not p.startswith(ELSEWHERE)])
def test_the_python_of_a_page_runs_from_top_to_bottom(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scope: dict[str, Any] = {"__name__": "__page__"}
    for block in of("python"):
        if block.page == page:
            exec(compile("\n" * (block.line - 1) + block.text, page, "exec"), scope)


@pytest.mark.parametrize("page", SHELL)
def test_the_commands_of_a_page_are_there(page: str, project_root: Path) -> None:
    for block in of("sh"):
        if block.page == page:
            for number, line in enumerate(block.text.splitlines(), block.line):
                try:
                    check(line, project_root)
                except Refused as error:
                    pytest.fail(f"{page}, line {number}: {line.strip()}: {error}")


@pytest.mark.parametrize(
    "line",
    [
        "make nothing",
        "make repro PROFILE=huge",
        "hdsafebo session aprove month",
        "hdsafebo report --out x",
        "dvc repo",
        "dvc repro --nothing",
        "pip install '.[nothing]'",
        "python examples/nothing.py",
        "python examples/any_environment.py Pendulum-v1 --nothing",
        "dask worker --nothing 3",
        "curl somewhere",
    ],
)
def test_a_command_that_is_not_there_is_noticed(line: str, project_root: Path) -> None:
    with pytest.raises(Refused):
        check(line, project_root)


@pytest.mark.parametrize("block", of("yaml"), ids=lambda b: f"{b.page}:{b.line}")
def test_yaml_is_yaml(block: Block) -> None:
    assert isinstance(yaml.safe_load(block.text), dict)


SCRIPTS = sorted((Path(__file__).parents[2] / tutorials.FOLDER).glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_a_tutorial_runs_and_its_page_is_of_this_script(script: Path) -> None:
    printed, figures = tutorials.run(script)
    shown = script.with_suffix(".md").read_text(encoding="utf-8")
    head, cells = tutorials.read(script)
    assert shown.startswith(head)
    for cell in cells:
        assert cell.text in shown
        for line in cell.code.splitlines():
            assert line.strip() in shown, "`make tutorials` writes the page again"
    assert figures
    assert any(printed)
    for number in range(len(figures)):
        picture = script.with_name(tutorials.picture_name(script, number))
        assert 5_000 < picture.stat().st_size < 200_000


def test_examples_are_run_by_a_test(project_root: Path) -> None:
    """Each program of `examples/` is loaded by `tests/test_examples.py`, or imported by one that is."""
    tested = (project_root / "tests/test_examples.py").read_text()
    programs = {path.stem: path.read_text() for path in (project_root / "examples").glob("*.py")}
    for name in programs:
        imported = any(
            isinstance(node, ast.ImportFrom) and node.module == name
            for other in programs.values()
            for node in ast.walk(ast.parse(other))
        )
        assert f'"{name}"' in tested or imported, name


def test_all_pages_are_looked_at(project_root: Path) -> None:
    assert project_root / "README.md" in PAGES
    assert len(PAGES) > 50
