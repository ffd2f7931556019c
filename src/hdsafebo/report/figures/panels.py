"""Figures made of panels: saved as one grid, shown on the page as separate, responsive pictures."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hdsafebo.report.methods import DASHES, MethodStyle

PANEL_INCHES = (3.7, 2.7)
PNG_DPI = 144
STYLE: dict[str, Any] = {
    "font.family": ["DejaVu Sans"],
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.6,
    "axes.edgecolor": "#555555",
    "xtick.color": "#333333",
    "ytick.color": "#333333",
    "lines.linewidth": 1.4,
    "lines.markersize": 4.5,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "svg.fonttype": "none",
    "svg.hashsalt": "hdsafebo",
    "path.simplify": True,
}


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
        inches: width and height on the page.
    """

    title: str
    draw: Callable[[Any], None]
    lines: list[Line] = field(default_factory=list)
    inches: tuple[float, float] = PANEL_INCHES


@dataclass(frozen=True)
class Figure:
    """A named figure: rows of panels, a caption, and the methods of its legend."""

    name: str
    caption: str
    rows: list[list[Panel]]
    legend: list[MethodStyle] = field(default_factory=list)


@dataclass(frozen=True)
class Picture:
    """A panel as the page shows it.

    Attributes:
        title: alternative text.
        svg: inline SVG.
        hover: geometry and values for the script; None when there is nothing to point at.
        inches: natural width and height.
    """

    title: str
    svg: str
    hover: dict[str, Any] | None
    inches: tuple[float, float]


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


def save(figure: Figure, folder: Path) -> list[Picture]:
    """Write `<name>.svg` and `<name>.png` into a folder and return the panels for the page."""
    import matplotlib

    with matplotlib.rc_context(STYLE):
        _save_grid(figure, folder)
        panels = [panel for row in figure.rows for panel in row]
        return [_picture(panel, f"{figure.name}-{k}") for k, panel in enumerate(panels)]


def _new_figure(inches: tuple[float, float], rows: int, columns: int) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as MatplotlibFigure

    canvas = MatplotlibFigure(figsize=inches, layout="constrained")
    FigureCanvasAgg(canvas)
    return canvas, canvas.subplots(rows, columns, squeeze=False)


def _save_grid(figure: Figure, folder: Path) -> None:
    from matplotlib.lines import Line2D

    columns = max(len(row) for row in figure.rows)
    width = max(sum(panel.inches[0] for panel in row) for row in figure.rows)
    height = sum(max(panel.inches[1] for panel in row) for row in figure.rows)
    canvas, axes = _new_figure((width, height + 0.35 * bool(figure.legend)), len(figure.rows), columns)
    for r, row in enumerate(figure.rows):
        for c in range(columns):
            if c < len(row):
                row[c].draw(axes[r, c])
            else:
                axes[r, c].set_axis_off()
    if figure.legend:
        handles = [Line2D([], [], label=style.label, **plot_style(style, 1)) for style in figure.legend]
        canvas.legend(
            handles=handles, loc="outside upper center", ncols=max(1, min(len(handles), int(width / 1.7)))
        )
    canvas.savefig(folder / f"{figure.name}.svg", metadata={"Date": None})
    canvas.savefig(folder / f"{figure.name}.png", dpi=PNG_DPI, metadata={"Software": None})


def _picture(panel: Panel, prefix: str) -> Picture:
    canvas, axes = _new_figure(panel.inches, 1, 1)
    ax = axes[0, 0]
    panel.draw(ax)
    buffer = io.StringIO()
    canvas.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    hover = None
    if panel.lines:
        box = ax.get_position()
        width, height = (72 * inches for inches in panel.inches)
        hover = {
            "box": [
                round(v, 2)
                for v in (box.x0 * width, (1 - box.y1) * height, box.width * width, box.height * height)
            ],
            "x": [float(v) for v in ax.get_xlim()],
            "lines": [
                {
                    "name": line.name,
                    "colour": line.colour,
                    "x": _short(line.x),
                    "y": _short(line.y),
                    "e": _short(line.error),
                }
                for line in panel.lines
            ],
        }
    return Picture(panel.title, _inline(buffer.getvalue(), prefix, panel.title), hover, panel.inches)


def _short(values: list[Any]) -> list[float | None]:
    """Four significant digits are what a pointer can read."""
    return [None if v is None or v != v else float(f"{v:.4g}") for v in values]


def _inline(svg: str, prefix: str, title: str) -> str:
    """An SVG document as an element of the page: identifiers made unique, size left to the style sheet."""
    from html import escape

    body = svg[svg.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.S)
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', body))

    def rename(match: re.Match[str]) -> str:
        return f' id="{prefix}-{match[1]}"' if match[1] in used else ""

    body = re.sub(r' id="([^"]+)"', rename, body)
    body = re.sub(r'(href="#|url\(#)', rf"\g<1>{prefix}-", body)
    label = escape(title, quote=True)
    return re.sub(
        r'<svg ([^>]*?)width="[^"]*" ',
        rf'<svg role="img" aria-label="{label}" \1',
        body.replace("\n", " "),
        count=1,
    ).replace(' height="', ' data-height="', 1)
