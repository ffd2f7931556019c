"""Figures made of panels, in one style."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from hdsafebo.report.data.methods import DASHES, MethodStyle

PANEL_INCHES = (3.7, 2.7)


@dataclass(frozen=True)
class Line:
    """Values that a reader can read off a curve by pointing at it: y(x) and its standard error."""

    name: str
    colour: str
    x: list[float]
    y: list[float | None]
    error: list[float | None]


@dataclass(frozen=True)
class Panel:
    """One picture.

    Attributes:
        title: what it shows; the alternative text on the page.
        draw: draws into matplotlib axes.
        lines: the curves that can be read by pointing.
        inches: width and height.
        left: inches left of the axes, for the labels there.
    """

    title: str
    draw: Callable[[Any], None]
    lines: list[Line] = field(default_factory=list)
    inches: tuple[float, float] = PANEL_INCHES
    left: float = 0.62


@dataclass(frozen=True)
class Figure:
    """A named figure: rows of panels, a caption, and the methods of its legend."""

    name: str
    caption: str
    rows: list[list[Panel]]
    legend: list[MethodStyle] = field(default_factory=list)


def plot_style(style: MethodStyle, points: int) -> dict[str, Any]:
    """Keyword arguments of `Axes.plot` for a method's curve of that many points."""
    return {
        "color": style.colour,
        "marker": style.marker,
        "linestyle": DASHES[style.dash],
        "markevery": max(1, points // 6),
        "markerfacecolor": style.colour,
        "markeredgecolor": "white",
        "markeredgewidth": 0.5,
        "linewidth": 2.0 if style.family == "ours" else 1.3,
        "zorder": 3 if style.family == "ours" else 2,
    }
