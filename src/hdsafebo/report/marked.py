"""Parts of Markdown files that are written from data, between two marks."""

from __future__ import annotations

from pathlib import Path

from hdsafebo.errors import DatasetError
from hdsafebo.files.bounded import read_text


def marked(path: Path, name: str) -> str:
    """What stands between the marks `<!-- NAME: ... -->` and `<!-- end of NAME -->`.

    Raises:
        DatasetError: the file has not exactly one such pair.
    """
    return _parts(path, name)[1]


def write_marked(path: Path, name: str, text: str) -> None:
    """Write `text` between the marks of that name, each mark on a line of its own.

    Raises:
        DatasetError: as `marked`.
    """
    before, _, after = _parts(path, name)
    path.write_text(f"{before}{text.rstrip()}\n{after}", encoding="utf-8")


def _parts(path: Path, name: str) -> tuple[str, str, str]:
    """Text up to the end of the first mark's line, between the marks, and from the second mark on."""
    text = read_text(path)
    begin, end = f"<!-- {name}: ", f"<!-- end of {name} -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise DatasetError(f"{path}: expected the mark {begin + '... -->'!r} once, and {end!r} once after it")
    start = text.index("\n", text.index(begin)) + 1
    return text[:start], text[start : text.index(end)], text[text.index(end) :]
