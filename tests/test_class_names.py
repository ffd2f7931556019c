"""A class name means one thing in the whole package."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path


def test_no_name_is_that_of_two_classes(project_root: Path) -> None:
    """Names that begin with an underscore are their module's own, and may recur."""
    where: defaultdict[str, list[str]] = defaultdict(list)
    for path in sorted((project_root / "src").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                where[node.name].append(f"{path.relative_to(project_root)}:{node.lineno}")
    assert len(where) > 300, "the classes of the package were not found"
    assert {name: places for name, places in where.items() if len(places) > 1} == {}
