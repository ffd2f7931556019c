"""What the documentation must have: every method, setting, stage, public name and test that it names."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

import hdsafebo
from hdsafebo.errors import DatasetError
from hdsafebo.report.data.outside import OUTSIDE
from hdsafebo.report.marked import marked
from hdsafebo.report.published import PUBLISHED
from tests.docs.blocks import PAGES
from tools.docs import api, curves, methods, pages, pipeline
from tools.docs.settings import settings_of


def text(root: Path, page: str) -> str:
    return (root / page).read_text(encoding="utf-8")


def test_pages_that_come_from_the_code_are_of_this_code(project_root: Path) -> None:
    written = pages.whole(project_root)
    assert len(written) > 20
    other = [page for page, content in written.items() if text(project_root, page) != content]
    assert other == [], "`make docs` writes them again"


def test_parts_of_pages_that_come_from_code_and_evidence_are_of_them(project_root: Path) -> None:
    for (page, name), part in pages.parts(project_root).items():
        assert marked(project_root / page, name) == f"{part.rstrip()}\n", page
    for (page, name), write in PUBLISHED.items():
        assert marked(project_root / page, name) == f"{write(project_root).rstrip()}\n", page


def test_no_page_is_of_a_method_that_is_gone(project_root: Path) -> None:
    assert pages.stale(project_root) == []


def test_every_method_with_kept_runs_has_its_curve_and_the_others_say_so(project_root: Path) -> None:
    names = {page.name for page in methods.method_pages()}
    runs = {path.stem for path in (project_root / OUTSIDE).parent.glob("*.json")} & names
    assert {"hdsafebo", "hdsafebo_local", "scbo", "cmaes"} <= runs
    kept = (project_root / curves.EVIDENCE).glob("synthetic-*.parquet")
    runs |= {path.stem.removeprefix("synthetic-") for path in kept} & names
    assert "safeopt" in runs
    drawn = curves.write(project_root, sorted(names))
    assert set(drawn) == {f"{curves.FOLDER}/{name}.svg" for name in runs}
    assert drawn == curves.write(project_root, sorted(names)), "drawn twice, it is the same"
    assert all("prefers-color-scheme:dark" in ElementTree.fromstring(svg)[1].text for svg in drawn.values())
    for name in names:
        shown = text(project_root, f"docs/methods/{name}.md")
        assert (f"](curves/{name}.svg)" in shown) == (name in runs)
        assert ("No runs of it are kept" in shown) == (name not in runs)


def test_a_curve_is_of_the_runs() -> None:
    def run(*best: float, safe: float) -> dict[str, object]:
        return {"best": list(best), "safe": safe}

    runs: curves.Runs = {
        "scbo": {"b": {"1": run(0, 1, 2, safe=0.5), "2": run(0, 3, 4, safe=1.0)}},
        "cmaes": {"a": {"1": run(0, 1, safe=1.0)}, "b": {"1": run(0, 9, safe=1.0)}},
    }
    (panel,) = curves.panels(runs, {"b": {"scbo": {"optimum": 5.0}}}, "scbo")
    assert (panel.label, panel.optimum, panel.safe) == ("b", 5.0, 0.75)
    assert panel.own.tolist() == [[0, 1, 2], [0, 3, 4]]
    assert [other.tolist() for other in panel.others] == [[0, 9]]


def test_a_curve_of_the_synthetic_task_is_of_its_runs(project_root: Path) -> None:
    runs = curves.read_synthetic(project_root)
    panel = curves.synthetic_panel(runs, "safeopt")
    trials = runs["safeopt"].trials
    for best, (_, own) in zip(panel.own, trials.groupby("seed"), strict=True):
        assert best[-1] == own.loc[own["safe"], "objective"].max()
    assert panel.own.shape == (20, 31), "300 trials in rounds of ten, and what was known before"
    assert (panel.optimum, panel.batch, len(panel.others)) == (None, 10, len(runs) - 1)


def test_every_setting_of_every_method_is_on_its_page_with_its_meaning(project_root: Path) -> None:
    for page in methods.method_pages():
        shown = text(project_root, f"docs/methods/{page.name}.md")
        assert all(f"`{name}`" in shown for name in page.names)
        for setting in settings_of(page.kind.Settings):
            assert setting.meaning, f"{page.name}.{setting.name} has no meaning in the docstring"
            assert f"| `{setting.name}` | " in shown, (page.name, setting.name)


def test_every_setting_of_the_pipeline_is_on_its_page_with_its_meaning(project_root: Path) -> None:
    shown = text(project_root, "docs/reproduction/params.md")
    settings = pipeline.params_settings()
    assert len(settings) > 80
    for setting in settings:
        assert setting.meaning, f"{setting.name} has no meaning in the docstring"
        assert f"| `{setting.name}` | " in shown, setting.name


def test_every_key_of_the_parameter_file_is_a_setting_on_the_page(project_root: Path) -> None:
    """From the file, not from the models, so that a block that the generator overlooks is noticed."""
    import yaml

    shown = text(project_root, "docs/reproduction/params.md")
    named = {"methods": "methods.NAME", "isometry.floors": "isometry.floors.NAME"}

    def keys(block: object, path: str) -> list[str]:
        if not isinstance(block, dict) or f"| `{path}` | " in shown or path in named:
            return [path]
        return [key for name, value in block.items() for key in keys(value, f"{path}.{name}".lstrip("."))]

    for key in keys(yaml.safe_load(text(project_root, "params.yaml")), ""):
        assert f"| `{key}` | " in shown or f"| `{named.get(key, '?')}." in shown, key


def test_every_stage_is_on_the_page(project_root: Path) -> None:
    shown = text(project_root, "docs/reproduction/stages.md")
    for stage in pipeline.stages_of(project_root):
        assert f"| `{stage}` | " in shown


def test_every_public_name_is_in_the_reference(project_root: Path) -> None:
    shown = "".join(page.read_text() for page in (project_root / "docs/api").glob("*.md"))
    documented = {path.rpartition(".")[2] for paths in api.public_paths().values() for path in paths}
    assert set(hdsafebo.__all__) - {"plots"} <= documented
    for paths in api.public_paths().values():
        assert all(f"::: {path}\n" in shown for path in paths)


def test_every_page_is_in_the_navigation(project_root: Path) -> None:
    navigation = text(project_root, "mkdocs.yml")
    for page in (project_root / "docs").rglob("*.md"):
        assert f" {page.relative_to(project_root / 'docs').as_posix()}\n" in navigation


def test_every_test_that_the_page_of_faults_names_is_there(project_root: Path) -> None:
    rows = re.findall(
        r"(?m)^\| (?!fault|---)(.*) \|$", text(project_root, "docs/concepts/what-can-go-wrong.md")
    )
    assert len(rows) > 40
    for row in rows:
        named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", row)
        assert named, f"no test is named: {row}"
        for path, name in named:
            tree = ast.parse(text(project_root, path))
            assert name in {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}, f"{path}::{name}"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_every_picture_has_a_text_alternative(page: Path) -> None:
    content = page.read_text(encoding="utf-8")
    for alternative, target in re.findall(r"!\[(.*?)\]\((.*?)\)", content):
        assert len(alternative) > 30, target
        assert (page.parent / target).exists(), target
    assert "<img" not in content


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_every_linked_file_is_there(page: Path, project_root: Path) -> None:
    """As they are in a clone; `tools/check_site.py` follows the links of the built site."""
    for target in re.findall(r"\]\((?!https?:|#)([^)#\s]+)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target
        inside = (page.parent / target).resolve().is_relative_to(project_root / "docs")
        assert inside or not page.is_relative_to(project_root / "docs"), f"{target} is no part of the site"


def test_the_readme_is_one_page(project_root: Path) -> None:
    lines = text(project_root, "README.md").splitlines()
    assert len(lines) <= 100
    first = "\n".join(lines[:14])
    assert "Where it falls short" in first
    assert len(re.findall(r"(?m)^\| (?!what|---)", marked(project_root / "README.md", "headline"))) <= 8


def test_marks_that_are_missing_are_named(tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text("<!-- end of a -->\n<!-- a: written -->\n")
    with pytest.raises(DatasetError, match="expected the mark '<!-- a: "):
        marked(tmp_path / "page.md", "a")
