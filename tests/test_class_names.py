"""A class name means one thing in the whole package, and asking for a class costs nothing."""

from __future__ import annotations

import ast
import importlib
import pkgutil
from collections import defaultdict
from pathlib import Path

import hdsafebo


def test_no_name_is_that_of_two_classes(project_root: Path) -> None:
    """Names that begin with an underscore are their module's own, and may recur."""
    where: defaultdict[str, list[str]] = defaultdict(list)
    for path in sorted((project_root / "src").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                where[node.name].append(f"{path.relative_to(project_root)}:{node.lineno}")
    assert len(where) > 300, "the classes of the package were not found"
    assert {name: places for name, places in where.items() if len(places) > 1} == {}


def test_protocols_that_are_asked_for_have_methods_only() -> None:
    """On Python 3.11 `isinstance(x, SomeProtocol)` evaluates the properties of `x`, in an order of chance."""
    found = {}
    for module in pkgutil.walk_packages(hdsafebo.__path__, "hdsafebo."):
        if module.name.endswith("__main__"):
            continue
        for value in vars(importlib.import_module(module.name)).values():
            if getattr(value, "_is_runtime_protocol", False) and value.__module__.startswith("hdsafebo"):
                parents = [parent for parent in value.__mro__ if getattr(parent, "_is_protocol", False)]
                members = {name for parent in parents for name in vars(parent) if not name.startswith("_")}
                found[value.__name__] = {name for name in members if not callable(getattr(value, name))}
    assert len(found) >= 4, "the protocols were not found"
    assert {name: members for name, members in found.items() if members} == {}
