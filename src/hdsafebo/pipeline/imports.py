"""Which modules of the package a file uses, found by reading its imports, without running them."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path

from hdsafebo.files.bounded import read_bytes

PACKAGE = "hdsafebo"
# Checking the parameters looks up names and settings of methods and embeddings; whoever uses their code
# imports it himself.
NAMES_ONLY = {"hdsafebo.pipeline.checked_params": ("hdsafebo.optimizers", "hdsafebo.embeddings")}


class ImportGraph:
    """The imports of a package's modules; each file is read once, when it is first met.

    Args:
        source: directory that holds the package.
    """

    def __init__(self, source: Path) -> None:
        self._source = source
        self._imported: dict[Path, set[Path]] = {}
        self._files: dict[str, set[Path]] = {}

    def used_by(self, roots: Iterable[Path]) -> set[Path]:
        """Files below the source that `roots` import, directly or not, at the top or within functions.

        Args:
            roots: Python files.

        Raises:
            SyntaxError: a file is no Python.
        """
        seen: set[Path] = set()
        pending = list(roots)
        while pending:
            fresh = self._imports_of(pending.pop()) - seen
            seen |= fresh
            pending.extend(fresh)
        return seen

    def file_of(self, module: str) -> Path:
        """The file of a module that is no package."""
        return self._source.joinpath(*module.split(".")).with_suffix(".py")

    def _imports_of(self, path: Path) -> set[Path]:
        if path not in self._imported:
            skip = NAMES_ONLY.get(self._module_name(path), ())
            names = {
                name
                for name in _imported_names(ast.parse(read_bytes(path)))
                if name.split(".")[0] == PACKAGE and not name.startswith(skip)
            }
            self._imported[path] = set().union(*map(self._files_of, names))
        return self._imported[path]

    def _files_of(self, name: str) -> set[Path]:
        """The file of a module and the `__init__.py` of the packages it lies in."""
        if name not in self._files:
            parts = name.split(".")
            found = {self._source.joinpath(*parts[:k], "__init__.py") for k in range(1, len(parts) + 1)}
            found.add(self.file_of(name))
            self._files[name] = {path for path in found if path.is_file()}
        return self._files[name]

    def _module_name(self, path: Path) -> str:
        if not path.is_relative_to(self._source):
            return path.stem
        return ".".join(path.relative_to(self._source).with_suffix("").parts)


def _imported_names(tree: ast.AST) -> set[str]:
    names: set[str] = set()
    for node in _executed(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def _executed(tree: ast.AST) -> Iterator[ast.AST]:
    """All nodes except those that only a type checker reads."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            continue
        yield node
        yield from _executed(node)
