"""What a section is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from hdsafebo.report.data.inputs import StoredFilm, StoredPicture
from hdsafebo.report.figures.panels import Figure
from hdsafebo.report.tables.results import Table


@dataclass(frozen=True)
class Text:
    """A paragraph; its kind decides how it looks."""

    text: str
    kind: Literal["plain", "heading", "size", "finding", "caution", "missing"] = "plain"


@dataclass(frozen=True)
class Details:
    """A table that is folded away behind its title."""

    title: str
    table: Table


Block = Text | Figure | Table | Details | StoredPicture | StoredFilm


@dataclass(frozen=True)
class Section:
    """A section of the page.

    Attributes:
        name: anchor.
        title: heading.
        source: where the paper has it.
        blocks: content, in order.
    """

    name: str
    title: str
    source: str
    blocks: list[Block]


def not_run(what: str) -> Text:
    """Says plainly that something is missing."""
    return Text(f"{what}: not run in this profile.", "missing")
