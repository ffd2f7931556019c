"""One version everywhere, a changelog that has it, and a check of the package that knows every extra."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import yaml

import hdsafebo
from tools.check_package import IMPORTS, example


def test_the_version_is_said_in_one_place(project_root: Path) -> None:
    project = tomllib.loads((project_root / "pyproject.toml").read_text())
    assert project["project"]["dynamic"] == ["version"]
    assert project["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "hdsafebo.__version__"}
    citation = yaml.safe_load((project_root / "CITATION.cff").read_text())
    assert citation["version"] == hdsafebo.__version__
    assert citation["preferred-citation"]["title"].startswith("Safe Bayesian Optimization")


def test_the_changelog_has_the_version_on_top_and_known_sections(project_root: Path) -> None:
    text = (project_root / "CHANGELOG.md").read_text()
    versions = re.findall(r"(?m)^## \[(.*?)\]", text)
    assert versions[:2] == ["Unreleased", hdsafebo.__version__]
    sections = set(re.findall(r"(?m)^#### (.*)$", text))
    assert sections <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


def test_the_check_of_the_package_knows_every_extra(project_root: Path) -> None:
    project = tomllib.loads((project_root / "pyproject.toml").read_text())["project"]
    assert IMPORTS.keys() == {"core", *project["optional-dependencies"]}
    assert "Study.open" in example()


def test_every_extra_is_on_the_page_of_installation(project_root: Path) -> None:
    page = (project_root / "docs/start/install.md").read_text()
    for extra in IMPORTS.keys() - {"core"}:
        assert f"`{extra}`" in page


def test_every_tested_python_is_a_classifier_and_on_the_page_of_installation(project_root: Path) -> None:
    project = tomllib.loads((project_root / "pyproject.toml").read_text())["project"]
    tested = re.findall(r"Python :: (3\.\d+)", " ".join(project["classifiers"]))
    assert project["requires-python"] == f">={tested[0]}"
    rows = re.findall(r"(?m)^\| (3\.[\d., ]+) \| ", (project_root / "docs/start/install.md").read_text())
    assert ", ".join(rows).split(", ") == tested
