"""Tutorials: a script in cells becomes a page with what the cells print and draw.

A cell begins with a line `# %% text`; comment lines below continue the text. A cell whose text begins with
`picture:` leaves a matplotlib figure in `figure`; the rest of its text is the picture's text alternative, and
its code is folded away. The script's docstring is the head of the page.
"""

from __future__ import annotations

import ast
import contextlib
import io
import os
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FOLDER = Path("docs/tutorials")
_PICTURE = "picture:"


@dataclass(frozen=True)
class Cell:
    """A part of a script.

    Attributes:
        text: what it is about.
        code: to run.
        picture: whether it draws one.
    """

    text: str
    code: str
    picture: bool


def read(path: Path) -> tuple[str, list[Cell]]:
    """Head and cells of a script."""
    source = path.read_text(encoding="utf-8")
    head = ast.get_docstring(ast.parse(source)) or ""
    cells = []
    for part in re.split(r"(?m)^# %% ", source)[1:]:
        lines = part.splitlines()
        more = 1
        while more < len(lines) and lines[more].startswith("# "):
            more += 1
        text = " ".join([lines[0], *(line[2:] for line in lines[1:more])])
        picture = text.startswith(_PICTURE)
        cells.append(Cell(text.removeprefix(_PICTURE).strip(), "\n".join(lines[more:]).strip(), picture))
    return head, cells


def run(path: Path) -> tuple[list[str], list[Any]]:
    """What each cell prints, and the figures; the working directory is an empty one."""
    scope: dict[str, Any] = {"__name__": "__tutorial__"}
    printed, figures = [], []
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for cell in read(path)[1]:
                out = io.StringIO()
                with contextlib.redirect_stdout(out):
                    exec(compile(cell.code, str(path), "exec"), scope)
                printed.append(out.getvalue())
                figures += [scope.pop("figure")] if cell.picture else []
        finally:
            os.chdir(before)
    return printed, figures


def page(path: Path, printed: list[str]) -> str:
    """The page in Markdown."""
    head, cells = read(path)
    parts, pictures = [head], 0
    for cell, output in zip(cells, printed, strict=True):
        code = f"```python\n{cell.code}\n```"
        if cell.picture:
            parts += [f"![{cell.text}]({picture_name(path, pictures)})"]
            parts += ['??? note "Code of the picture"\n\n' + _indented(code)]
            pictures += 1
        else:
            parts += [cell.text, code]
        if output.strip():
            parts.append(f"```text\n{output.strip()}\n```")
    return "\n\n".join(parts) + "\n"


def picture_name(path: Path, number: int) -> str:
    """File name of a tutorial's picture."""
    return f"{path.stem}{number or ''}.png"


def write(root: Path) -> None:
    """Run all tutorials and write their pages and pictures."""
    for path in sorted((root / FOLDER).glob("*.py")):
        printed, figures = run(path)
        for number, figure in enumerate(figures):
            figure.savefig(path.with_name(picture_name(path, number)), metadata={"Software": None})
        path.with_suffix(".md").write_text(page(path, printed), encoding="utf-8")


def _indented(text: str) -> str:
    return "\n".join(f"    {line}" if line else "" for line in text.splitlines())
