"""Draws figures: one grid of panels per PNG, of which the page shows the panels one by one."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from hdsafebo.report.figures.panels import Figure, Panel, plot_style

PNG_DPI = 144
LEGEND_INCHES = 0.3
MARGINS_INCHES = {"right": 0.14, "bottom": 0.46, "top": 0.3}
_COLOURS = 128
STYLE: dict[str, Any] = {
    "font.family": ["DejaVu Sans"],
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9,
    "axes.titlelocation": "left",
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
    "path.simplify": True,
}


@dataclass(frozen=True)
class Picture:
    """A panel as the page shows it: a rectangle of its figure's PNG.

    Attributes:
        title: alternative text.
        file: name of the PNG.
        place: left, top, width and height of the panel as shares of the whole picture.
        hover: geometry and values for the script; None when there is nothing to point at.
        inches: natural width and height.
    """

    title: str
    file: str
    place: tuple[float, float, float, float]
    hover: dict[str, Any] | None
    inches: tuple[float, float]


@dataclass(frozen=True)
class _Cell:
    """Place of a panel in its figure: left, top, width and height in points, from the upper left corner."""

    panel: Panel
    axes: Any
    box: tuple[float, float, float, float]


def save(figure: Figure, folder: Path) -> list[Picture]:
    """Write `<name>.png` into a folder and return the panels for the page.

    The picture has a palette of 128 colours, which takes a third of the bytes; the same figure gives the same
    bytes.
    """
    import matplotlib
    from PIL import Image

    with matplotlib.rc_context(cast(Any, STYLE)):  # Matplotlib types the names of its settings one by one
        canvas, cells = _draw(figure)
        buffer = io.BytesIO()
        canvas.savefig(buffer, format="png", dpi=PNG_DPI, metadata={"Software": None})
    picture = Image.open(buffer).convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE)
    file = f"{figure.name}.png"
    picture.save(folder / file, optimize=True)
    width, height = (72 * float(v) for v in canvas.get_size_inches())
    return [_picture(file, cell, width, height) for cell in cells]


def _draw(figure: Figure) -> tuple[Any, list[_Cell]]:
    """A matplotlib figure with every panel in its cell, and the cells."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as MatplotlibFigure

    width = max(sum(panel.inches[0] for panel in row) for row in figure.rows)
    top = LEGEND_INCHES * _legend_rows(figure, width)
    height = top + sum(max(panel.inches[1] for panel in row) for row in figure.rows)
    canvas = MatplotlibFigure(figsize=(width, height))
    FigureCanvasAgg(canvas)
    if figure.legend:
        _draw_legend(canvas, figure, width)
    cells: list[_Cell] = []
    y = top
    for row in figure.rows:
        x = 0.0
        for panel in row:
            cells.append(_draw_panel(canvas, panel, x, y))
            x += panel.inches[0]
        y += max(panel.inches[1] for panel in row)
    return canvas, cells


def _draw_panel(canvas: Any, panel: Panel, x: float, y: float) -> _Cell:
    """Draw a panel into its cell, whose upper left corner is at (x, y) inches."""
    width, height = canvas.get_size_inches()
    w, h = panel.inches
    m = MARGINS_INCHES
    inner = (
        x + panel.left,
        height - y - h + m["bottom"],
        w - panel.left - m["right"],
        h - m["bottom"] - m["top"],
    )
    axes = canvas.add_axes((inner[0] / width, inner[1] / height, inner[2] / width, inner[3] / height))
    axes.locator_params(nbins=5)
    panel.draw(axes)
    return _Cell(panel, axes, (72 * x, 72 * y, 72 * w, 72 * h))


def _legend_columns(figure: Figure, width: float) -> int:
    return max(1, min(len(figure.legend), int(width / 1.75)))


def _legend_rows(figure: Figure, width: float) -> int:
    return -(-len(figure.legend) // _legend_columns(figure, width))


def _draw_legend(canvas: Any, figure: Figure, width: float) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], label=style.label, **plot_style(style, 1)) for style in figure.legend]
    canvas.legend(
        handles=handles, loc="upper center", ncols=_legend_columns(figure, width), borderaxespad=0.3
    )


def _picture(file: str, cell: _Cell, width: float, height: float) -> Picture:
    """One panel of a figure of so many points."""
    x, y, w, h = cell.box
    place = (x / width, y / height, w / width, h / height)
    return Picture(cell.panel.title, file, place, _hover(cell, width, height), cell.panel.inches)


def _hover(cell: _Cell, width: float, height: float) -> dict[str, Any] | None:
    """For the script of the page: place of the axes as shares of the panel, and the values of its lines."""
    if not cell.panel.lines:
        return None
    box = cell.axes.get_position()
    x, y, w, h = cell.box
    place = (
        (box.x0 * width - x) / w,
        ((1 - box.y1) * height - y) / h,
        box.width * width / w,
        box.height * height / h,
    )
    return {
        "box": [round(v, 4) for v in place],
        "x": [float(v) for v in cell.axes.get_xlim()],
        "lines": [
            {
                "name": line.name,
                "colour": line.colour,
                "x": _short(line.x),
                "y": _short(line.y),
                "e": _short(line.error),
            }
            for line in cell.panel.lines
        ],
    }


def _short(values: list[Any]) -> list[float | None]:
    """Four significant digits are what a pointer can read."""
    return [None if v is None or v != v else float(f"{v:.4g}") for v in values]
