"""Which modules of the package a file uses, found by reading its imports, without running them."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path

PACKAGE = "hdsafebo"
# Checking the parameters looks up names and settings of methods and embeddings; whoever uses their code
# imports it himself.
NAMES_ONLY = {"hdsafebo.pipeline.checked_params": ("hdsafebo.optimizers", "hdsafebo.embeddings")}


def used_modules(roots: Iterable[Path], source: Path) -> set[Path]:
    """Files below `source` that `roots` import, directly or not, at the top or within functions.

    Args:
        roots: Python files.
        source: directory that holds the package.

    Raises:
        SyntaxError: a file is no Python.
    """
    seen: set[Path] = set()
    pending = list(roots)
    while pending:
        for path in _imported(pending.pop(), source):
            if path not in seen:
                seen.add(path)
                pending.append(path)
    return seen


def _imported(path: Path, source: Path) -> set[Path]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    module = _module_name(path, source)
    names: set[str] = set()
    for node in _executed(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    skip = NAMES_ONLY.get(module, ())
    files = set()
    for name in names:
        if name.split(".")[0] != PACKAGE or name.startswith(skip):
            continue
        files |= _files(name, source)
    return files


def _executed(tree: ast.AST) -> Iterator[ast.AST]:
    """All nodes except those that only a type checker reads."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            continue
        yield node
        yield from _executed(node)


def _files(name: str, source: Path) -> set[Path]:
    """The file of a module and the `__init__.py` of the packages it lies in."""
    parts = name.split(".")
    found = {source.joinpath(*parts[:k], "__init__.py") for k in range(1, len(parts) + 1)}
    found.add(source.joinpath(*parts).with_suffix(".py"))
    return {path for path in found if path.is_file()}


def _module_name(path: Path, source: Path) -> str:
    if not path.is_relative_to(source):
        return path.stem
    return ".".join(path.relative_to(source).with_suffix("").parts)
