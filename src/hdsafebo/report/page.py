"""The page: one HTML file beside a folder of pictures; it needs no network."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from hdsafebo.report.claims.base import OWN_LABELS, STATUS_LABELS, Claim, Status
from hdsafebo.report.data.inputs import StoredFilm, StoredPicture
from hdsafebo.report.data.methods import DASHES, MethodStyle, style
from hdsafebo.report.figures.drawing import Picture, save
from hdsafebo.report.figures.panels import Figure
from hdsafebo.report.sections.base import Details, Section, Text
from hdsafebo.report.tables.results import Table

_WIDE_INCHES = 6.25


@dataclass(frozen=True)
class Overview:
    """The top of the page.

    Attributes:
        profile: sizes of the run.
        git_revision: of the code; None outside a repository.
        claims: of the paper, with verdicts.
        own: what this project says of its own method, with verdicts.
        leaders: the best method per task.
        left_out: run files that are there but not part of the report.
    """

    profile: str
    git_revision: str | None
    claims: list[Claim]
    own: list[Claim]
    leaders: Table
    left_out: list[str]


def render(overview: Overview, sections: list[Section], figures: Path) -> str:
    """The page's HTML; every figure of the sections is written into the folder `figures` on the way."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    assets = files("hdsafebo.report")
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = environment.from_string(assets.joinpath("page.html").read_text(encoding="utf-8"))
    blocks = {section.name: [_block(block, figures) for block in section.blocks] for section in sections}
    return template.render(
        overview=overview,
        sections=sections,
        blocks=blocks,
        counts=_counts(overview.claims),
        status_labels=STATUS_LABELS,
        own_labels=OWN_LABELS,
        method_label=lambda name: style(name).label,
        css=Markup(assets.joinpath("page.css").read_text(encoding="utf-8")),
        script=Markup(assets.joinpath("page.js").read_text(encoding="utf-8")),
    )


def _counts(claims: list[Claim]) -> dict[str, dict[Status, int]]:
    """How many claims have each status: for HdSafeBO all, for HdSafeBO-local those held to the same rule."""
    all_claims = [next(iter(claim.verdicts.values())).status for claim in claims]
    shared = [c.verdicts["hdsafebo_local"].status for c in claims if "hdsafebo_local" in c.verdicts]
    return {"hdsafebo": dict(Counter(all_claims)), "hdsafebo_local": dict(Counter(shared))}


def _block(block: Any, figures: Path) -> dict[str, Any]:
    """What the template needs to show a block."""
    from markupsafe import Markup

    if isinstance(block, Text):
        return {"kind": "text", "text": block.text, "style": block.kind}
    if isinstance(block, Table):
        return {"kind": "table", "table": block}
    if isinstance(block, Details):
        return {"kind": "details", "title": block.title, "table": block.table}
    if isinstance(block, StoredPicture):
        file = f"frame_{hashlib.sha256(block.data).hexdigest()[:12]}.png"
        (figures / file).write_bytes(block.data)
        return {"kind": "frame", "title": block.title, "file": file, "wide": block.is_wide}
    if isinstance(block, StoredFilm):
        file = f"film_{hashlib.sha256(block.data).hexdigest()[:12]}.mp4"
        (figures / file).write_bytes(block.data)
        return {"kind": "film", "title": block.title, "file": file}
    if isinstance(block, Figure):
        return {
            "kind": "figure",
            "name": block.name,
            "caption": block.caption,
            "panels": [_panel(picture, Markup) for picture in save(block, figures)],
            "legend": [(look.label, Markup(_swatch(look))) for look in block.legend],
        }
    raise TypeError(f"a section holds a {type(block).__name__}; expected one of the block types")


def _panel(picture: Picture, markup: Any) -> dict[str, Any]:
    hover = None
    if picture.hover is not None:
        text = json.dumps(picture.hover, separators=(",", ":"), allow_nan=False)
        hover = markup(escape(text, quote=False).replace("'", "&#39;"))
    return {
        "title": picture.title,
        "hover": hover,
        "style": markup(_crop(picture)),
        "wide": picture.inches[0] > _WIDE_INCHES,
    }


def _crop(picture: Picture) -> str:
    """CSS that shows one panel of a picture, at any size."""
    x, y, w, h = picture.place

    def position(start: float, size: float) -> float:
        return 0.0 if size >= 1 else 100 * start / (1 - size)  # as background-position counts

    width, height = (round(96 * v) for v in picture.inches)
    return (
        f"--width:{width}px;aspect-ratio:{width}/{height};background-image:url(figures/{picture.file});"
        f"background-size:{100 / w:.3f}% {100 / h:.3f}%;"
        f"background-position:{position(x, w):.3f}% {position(y, h):.3f}%"
    )


MARKER_SHAPES = {
    "o": '<circle cx="17" cy="7" r="3.4"/>',
    "s": '<rect x="13.8" y="3.8" width="6.4" height="6.4"/>',
    "^": '<path d="M17 3 L21 10 H13 Z"/>',
    "v": '<path d="M17 11 L21 4 H13 Z"/>',
    "D": '<path d="M17 2.6 L21.4 7 L17 11.4 L12.6 7 Z"/>',
    "P": '<path d="M15.5 3h3v2.5h2.5v3h-2.5v2.5h-3v-2.5h-2.5v-3h2.5z"/>',
    "X": '<path d="M14 4l3 3 3-3M14 10l3-3 3 3" stroke-width="2.4"/>',
    "*": '<path d="M17 2.5l1.4 3 3.3.4-2.4 2.3.6 3.3-2.9-1.6-2.9 1.6.6-3.3-2.4-2.3 3.3-.4z"/>',
    "p": '<path d="M17.0 2.8 L21.0 5.7 L19.5 10.4 L14.5 10.4 L13.0 5.7 Z"/>',
    "h": '<path d="M17.0 2.8 L20.6 4.9 L20.6 9.1 L17.0 11.2 L13.4 9.1 L13.4 4.9 Z"/>',
}
"""Of Matplotlib's markers, as they stand in legends."""


def _swatch(look: MethodStyle) -> str:
    """A small picture of a method's line and marker."""
    dash = DASHES[look.dash]
    pattern = (
        f' stroke-dasharray="{" ".join(str(1.4 * v) for v in dash[1])}"' if isinstance(dash, tuple) else ""
    )
    frame = f'viewBox="0 0 34 14" width="34" height="14" stroke="{look.colour}" fill="{look.colour}"'
    line = f'<path d="M1 7H33" fill="none" stroke-width="2"{pattern}/>'
    return f'<svg {frame} aria-hidden="true">{line}{MARKER_SHAPES[look.marker]}</svg>'
