"""Google docstrings as Markdown, and the meaning that they give to each attribute."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable

from griffe import Docstring, DocstringSectionKind


def attributes(kind: type) -> dict[str, str]:
    """Meaning of each attribute, from the docstrings of a class and those it inherits from."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        for section in _sections(base.__dict__.get("__doc__") or ""):
            if section.kind is DocstringSectionKind.attributes:
                found |= {item.name: plain(" ".join(item.description.split())) for item in section.value}
    return found


def text(docstring: str | None) -> str:
    """The free text of a docstring: first line as a sentence, indented blocks as they are."""
    parts = []
    for section in _sections(docstring or ""):
        if section.kind is DocstringSectionKind.text:
            parts.append(fence_blocks(section.value))
        elif section.kind is DocstringSectionKind.admonition:  # a line that ends with a colon, and a block
            parts += [f"{section.title}:", f"```text\n{section.value.contents}\n```"]
    return "\n\n".join(parts)


def fence_blocks(source: str) -> str:
    """Indented blocks between fences, which show them as they are."""
    paragraphs = re.split(r"\n\n(?=\S|    )", source)
    return "\n\n".join(map(_paragraph, paragraphs))


def plain(source: str) -> str:
    """Words as they stand: a star is a star, outside of code, unless it begins an item."""
    parts = re.split(r"(`[^`]*`)", source)
    return "".join(
        part if part.startswith("`") else re.sub(r"(?m)(?<!^)\*|^\*(?! )", r"\\*", part) for part in parts
    )


def _paragraph(source: str) -> str:
    lines = source.splitlines()
    start = next((i for i, line in enumerate(lines) if line.startswith("    ")), None)
    if start is None:
        return plain(source)
    block = inspect.cleandoc("\n" + "\n".join(lines[start:]))
    before = plain("\n".join(lines[:start]))
    return f"{before}\n\n```text\n{block}\n```".strip()


def _sections(docstring: str) -> Iterable[object]:
    return Docstring(inspect.cleandoc(docstring)).parse("google", warnings=False)
