"""HTML in which every text is escaped, because nothing else can be put into it."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from hdsafebo.session.words import shown


class Html(str):
    """Text that is HTML already; made by `tag` and `raw` alone."""

    __slots__ = ()


def tag(name: str, *children: object, **attributes: str) -> Html:
    """An element; children that are no HTML are escaped, their invisible characters written out."""
    words = "".join(f' {key.rstrip("_")}="{escape(value)}"' for key, value in attributes.items())
    return Html(f"<{name}{words}>{join(children)}</{name}>")


def join(children: Iterable[object]) -> Html:
    """Children one behind the other; see `tag`."""
    return Html("".join(c if isinstance(c, Html) else escape(shown(str(c))) for c in children))


def raw(text: str) -> Html:
    """HTML that this program wrote itself (a picture, a style)."""
    return Html(text)


def table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> Html:
    """A table; rows that hold the word UNSAFE are marked."""
    lines = []
    for row in rows:
        cells = list(row)
        marked = any("UNSAFE" in str(cell) for cell in cells)
        parts = [tag("td", cell) for cell in cells]
        lines.append(tag("tr", *parts, class_="unsafe") if marked else tag("tr", *parts))
    header = tag("thead", tag("tr", *(tag("th", name) for name in head)))
    return tag("table", header, tag("tbody", *lines))
