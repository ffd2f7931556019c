"""Pages of the public names, one for each part of the package; mkdocstrings shows their docstrings."""

from __future__ import annotations

import inspect
from collections import defaultdict
from pathlib import Path

import hdsafebo
from hdsafebo.errors import HdSafeBOError

PAGES = {
    "system": ("Systems and studies", "Describe a system by names and units; ask and tell in tables."),
    "problems": ("Problems and trials", "Arrays in, arrays out: what methods see of a trial."),
    "optimizers": ("Methods", "Ask, tell, save and load; for settings see [methods](../methods/index.md)."),
    "policies": ("Policies of environments", "Safe search over policies of a Gymnasium environment."),
    "sessions": ("Sessions", "Trials with a person in the loop; see [the guide](../session.md)."),
    "plots": ("Figures of a study", "Functions that return matplotlib figures."),
    "errors": ("Errors and warnings", "Whatever is raised on purpose."),
}  # fmt: skip
_ROOMS = {
    "system": "system",
    "problem": "problems",
    "trials": "problems",
    "optimizers": "optimizers",
    "policies": "policies",
    "session": "sessions",
    "plots": "plots",
    "errors": "errors",
}

_OPTIONS = {
    "errors": "{members: false}",
    "sessions": "{inherited_members: true}",  # a session's steps and what it shows are two classes
}


def write(root: Path) -> dict[str, str]:
    """Texts by path below the project's root."""
    return {f"docs/api/{page}.md": _page(page, paths) for page, paths in public_paths().items()}


def public_paths() -> dict[str, list[str]]:
    """Full paths of all public names, by page."""
    paths: dict[str, list[str]] = defaultdict(list)
    for name in hdsafebo.__all__:
        value = getattr(hdsafebo, name)
        if inspect.ismodule(value):
            paths["plots"] += [f"{getattr(value, n).__module__}.{n}" for n in value.__all__]
        else:
            path = f"{value.__module__}.{value.__qualname__}"
            paths[_ROOMS[path.split(".")[1]]].append(path)
    return {page: paths[page] for page in PAGES}


def _page(page: str, paths: list[str]) -> str:
    title, summary = PAGES[page]
    if page == "errors":
        paths = sorted(paths, key=lambda path: path.rpartition(".")[2] != HdSafeBOError.__name__)
    options = f"\n    options: {_OPTIONS[page]}" if page in _OPTIONS else ""
    entries = [f"::: {path}{options}" for path in paths]
    return "\n\n".join([f"# {title}", summary, *entries]) + "\n"
