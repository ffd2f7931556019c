"""Blocks of code in the Markdown files that people read."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
_FENCE = re.compile(r"(?ms)^( *)```(.*?)\n(.*?)^\1```[ \t]*$")


@dataclass(frozen=True)
class Block:
    """A fenced block.

    Attributes:
        page: path below the root.
        line: its first line.
        language: after the fence; empty where nothing is.
        text: what is in it.
    """

    page: str
    line: int
    language: str
    text: str


def blocks(path: Path) -> list[Block]:
    """All fenced blocks of a file."""
    content = path.read_text(encoding="utf-8")
    found = []
    for match in _FENCE.finditer(content):
        indent, info, text = match.groups()
        language = (info.split() or [""])[0]
        text = re.sub(rf"(?m)^{indent}", "", text)
        line = content[: match.start()].count("\n") + 2
        found.append(Block(path.relative_to(ROOT).as_posix(), line, language, text))
    return found


ALL = [block for page in PAGES for block in blocks(page)]


def of(*languages: str) -> list[Block]:
    """Blocks in these languages."""
    return [block for block in ALL if block.language in languages]
