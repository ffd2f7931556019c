"""Who reads a file asks first whether it is a regular one: a pipe would hold its reader for ever."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

READERS = {
    "read_text",
    "read_bytes",
    "ParquetFile",
    "read_table",
    "read_schema",
    "safe_open",
    "loadtxt",
    "genfromtxt",
}
GUARDS = {"require_regular", "open_regular"}
OWN_FILES = {"report/page.py"}  # what the package itself brings along
MIXED = {
    "session/measuring/tables.py": "its `read_table` reads what was read before",
    "session/advice/setup.py": "calls that `read_table`",
    "session/create.py": "calls that `read_table`",
    "session/log/sqlite_format.py": "reads a copy, which it makes of regular files only",
}


def _called(node: ast.AST) -> Iterator[tuple[str, ast.Call]]:
    for each in ast.walk(node):
        if isinstance(each, ast.Call):
            function = each.func
            yield getattr(function, "attr", getattr(function, "id", "")), each


def _reads(name: str, call: ast.Call) -> bool:
    """Whether a call opens a file for reading; `files.bounded` has functions of the same names."""
    if name in ("read_text", "read_bytes"):
        return isinstance(call.func, ast.Attribute)
    if name == "open":
        given = [*call.args, *(k.value for k in call.keywords)]
        values = [a.value for a in given if isinstance(a, ast.Constant)]
        modes = [v for v in values if isinstance(v, str) and 0 < len(v) <= 3 and set(v) <= set("rwxab+t")]
        return bool(modes) and "r" in modes[0]
    if name == "connect":
        return isinstance(call.func, ast.Attribute) and ast.unparse(call.func) == "sqlite3.connect"
    return name in READERS


def _modules(root: Path) -> list[Path]:
    return sorted([*(root / "src/hdsafebo").rglob("*.py"), *(root / "stages").glob("*.py")])


def unguarded(source: str) -> list[str]:
    """Functions that read a file and do not ask what it is."""
    found = []
    for function in ast.walk(ast.parse(source)):
        if isinstance(function, ast.FunctionDef):
            calls = list(_called(function))
            if any(_reads(*c) for c in calls) and not GUARDS & {name for name, _ in calls}:
                found.append(function.name)
    return found


@pytest.mark.parametrize(
    ("body", "is_found"),
    [
        ("path.read_text()", True),
        ("read_text(path)", False),
        ('path.open("rb")', True),
        ("open(path, mode='r')", True),
        ('path.open("wb")', False),
        ("Study.open(path)", False),
        ("sqlite3.connect(path)", True),
        ("socket.connect(path)", False),
        ("pq.read_table(path)", True),
        ("require_regular(path); pq.read_table(path)", False),
        ("safe_open(path)", True),
    ],
)
def test_readers_are_found(body: str, is_found: bool) -> None:
    assert unguarded(f"def f(path): {body}") == ["f"] * is_found


def test_no_function_reads_what_may_be_a_pipe(project_root: Path) -> None:
    package = project_root / "src/hdsafebo"
    found = {
        f"{name}: {function}"
        for path in _modules(project_root)
        if (name := str(path.relative_to(package if package in path.parents else project_root)))
        not in OWN_FILES
        and name not in MIXED
        and not name.startswith("files/")
        for function in unguarded(path.read_text(encoding="utf-8"))
    }
    assert found == set()
