"""Draws figures: one grid of panels per file, cut into its panels for the page."""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ET
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from hdsafebo.report.figures.panels import Figure, Panel, plot_style

PNG_DPI = 144
LEGEND_INCHES = 0.3
MARGINS_INCHES = {"right": 0.14, "bottom": 0.46, "top": 0.3}
_SVG = "http://www.w3.org/2000/svg"
_XLINK = "http://www.w3.org/1999/xlink"
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
    "svg.fonttype": "none",
    "svg.hashsalt": "hdsafebo",
    "path.simplify": True,
}


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


@dataclass(frozen=True)
class _Cell:
    """Place of a panel in its figure: left, top, width and height in points, from the upper left corner."""

    panel: Panel
    axes: Any
    box: tuple[float, float, float, float]


def save(figure: Figure, folder: Path) -> list[Picture]:
    """Write `<name>.svg` and `<name>.png` into a folder and return the panels for the page."""
    import matplotlib

    with matplotlib.rc_context(cast(Any, STYLE)):  # Matplotlib types the names of its settings one by one
        canvas, cells = _draw(figure)
        buffer = io.StringIO()
        canvas.savefig(buffer, format="svg", metadata={"Date": None})
        (folder / f"{figure.name}.svg").write_text(buffer.getvalue(), encoding="utf-8")
        canvas.savefig(folder / f"{figure.name}.png", dpi=PNG_DPI, metadata={"Software": None})
    document = ET.fromstring(buffer.getvalue())
    return [_picture(document, cell, f"{figure.name}-{k}") for k, cell in enumerate(cells)]


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
            cells.append(_draw_panel(canvas, panel, x, y, f"panel_{len(cells)}"))
            x += panel.inches[0]
        y += max(panel.inches[1] for panel in row)
    return canvas, cells


def _draw_panel(canvas: Any, panel: Panel, x: float, y: float, name: str) -> _Cell:
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
    axes.set_gid(name)
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


def _picture(document: ET.Element, cell: _Cell, prefix: str) -> Picture:
    """One panel cut out of a figure's SVG document."""
    x, y, width, height = cell.box
    group = document.find(f".//*[@id='{cell.axes.get_gid()}']")
    assert group is not None
    root = ET.Element(
        f"{{{_SVG}}}svg",
        {"viewBox": f"{x:g} {y:g} {width:g} {height:g}", "role": "img", "aria-label": cell.panel.title},
    )
    root.append(deepcopy(group))
    _add_definitions(root, document)
    _rename(root, prefix)
    ET.register_namespace("", _SVG)
    ET.register_namespace("xlink", _XLINK)
    svg = re.sub(r"\n\s*", " ", ET.tostring(root, encoding="unicode"))
    return Picture(cell.panel.title, svg, _hover(cell, document), cell.panel.inches)


def _references(element: ET.Element) -> set[str]:
    """Identifiers that an element and its children point at."""
    values = [value for e in element.iter() for value in e.attrib.values()]
    return {
        name
        for value in values
        for name in re.findall(r"^#(.+)$|url\(#([^)]+)\)", value)
        for name in name
        if name
    }


def _add_definitions(root: ET.Element, document: ET.Element) -> None:
    """Copy the markers and clipping paths that a panel uses but another part of the document defines."""
    own = {e.get("id") for e in root.iter()}
    definitions = ET.SubElement(root, f"{{{_SVG}}}defs")
    missing = _references(root) - own
    for element in document.iter():
        if element.get("id") in missing:
            definitions.append(deepcopy(element))


def _rename(root: ET.Element, prefix: str) -> None:
    """Make identifiers unique on the page and drop those that nothing points at."""
    used = _references(root)
    for element in root.iter():
        name = element.get("id")
        if name is not None and name not in used:
            del element.attrib["id"]
        for key, value in element.attrib.items():
            if key == "id":
                element.set(key, f"{prefix}-{value}")
            elif "#" in value:
                element.set(key, re.sub(r"^#(?=\w)(?![0-9a-fA-F]{6}$)|(?<=url\()#", f"#{prefix}-", value))


def _hover(cell: _Cell, document: ET.Element) -> dict[str, Any] | None:
    """Place of the axes in the panel and the values of its lines, for the script of the page."""
    if not cell.panel.lines:
        return None
    box = cell.axes.get_position()
    width, height = (float(v) for v in (document.get("viewBox") or "").split()[2:])
    x, y = cell.box[:2]
    place = (box.x0 * width - x, (1 - box.y1) * height - y, box.width * width, box.height * height)
    return {
        "box": [round(v, 2) for v in place],
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
