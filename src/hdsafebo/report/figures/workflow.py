"""The workflow of HdSafeBO (the paper's Figure 1), drawn."""

from __future__ import annotations

from typing import Any

import numpy as np

from hdsafebo.report.data.methods import BLUE, GREEN, PURPLE
from hdsafebo.report.figures.panels import Figure, Panel

_BOXES = (
    # x, y, width, height, title, text
    (0.0, 2.35, 2.5, 1.3, "Trials", "inputs x (D up to thousands)\nobjective f(x), safety g(x)"),
    (3.3, 2.35, 2.5, 1.3, "Isometric embedding", "z = Π(x), |z − z′| = |x − x′|\nd coordinates"),
    (6.6, 2.35, 2.5, 1.3, "Gaussian processes", "μ, σ of f and μ, σ of g,\nrefitted every round"),
    (0.0, 0.0, 2.5, 1.3, "Evaluate", "x = Π⁻¹(z) on the system\nthen SafeUpdate of the side l"),
    (
        3.3,
        0.0,
        2.5,
        1.3,
        "Thompson sampling",
        "maxima of posterior samples of f\nover the safe set: a batch z",
    ),
)
_ARROWS = (
    ((2.5, 3.0), (3.3, 3.0)),
    ((5.8, 3.0), (6.6, 3.0)),
    ((7.85, 2.35), (7.85, 1.72)),
    ((6.6, 0.65), (5.8, 0.65)),
    ((3.3, 0.65), (2.5, 0.65)),
    ((1.25, 1.3), (1.25, 2.35)),
)


def workflow_figure() -> Figure:
    """Encode, model, search safely and locally, decode, evaluate."""
    caption = (
        "Workflow of HdSafeBO. Each round encodes all trials, fits one Gaussian process to the objective "
        "and one to each safety function, keeps the part of a box around the best safe point where the "
        "bound μ + βσ of the safety meets its threshold (shaded), takes a batch of Thompson samples from "
        "it, decodes and evaluates them, and grows or shrinks the box."
    )
    return Figure(
        "workflow",
        caption,
        [[Panel("Workflow of HdSafeBO: a loop of six steps", _draw, inches=(9.6, 5.0), left=0.14)]],
    )


def _draw(ax: Any) -> None:
    from matplotlib.patches import FancyBboxPatch

    ax.set_axis_off()
    ax.set_xlim(-0.1, 9.2)
    ax.set_ylim(-0.35, 3.85)
    ax.set_aspect("equal")
    for x, y, width, height, title, text in _BOXES:
        ax.add_patch(
            FancyBboxPatch(
                (x + 0.06, y + 0.06),
                width - 0.12,
                height - 0.12,
                boxstyle="round,pad=0.06",
                facecolor="#f4f4f4",
                edgecolor="#444444",
            )
        )
        ax.text(
            x + width / 2,
            y + 0.92 * height - 0.12,
            title,
            ha="center",
            va="center",
            fontsize=10,
            weight="bold",
        )
        ax.text(
            x + width / 2, y + 0.4 * height, text, ha="center", va="center", fontsize=8.5, linespacing=1.5
        )
    for start, end in _ARROWS:
        ax.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": "#444444", "linewidth": 1.3})
    _draw_safe_set(ax, 6.6, -0.3, 2.5, 1.95)


def _draw_safe_set(ax: Any, x: float, y: float, width: float, height: float) -> None:
    """A sketch of the trust region and of the optimistic safe set inside it."""
    from matplotlib.patches import Polygon, Rectangle

    ax.add_patch(Rectangle((x, y), width, height, facecolor="white", edgecolor="#444444"))
    ax.text(
        x + width / 2,
        y + height - 0.17,
        "Safe set in a trust region",
        ha="center",
        va="center",
        fontsize=10,
        weight="bold",
    )
    angle = np.linspace(0, 2 * np.pi, 160)
    radius = 1 + 0.16 * np.cos(3 * angle + 0.4) + 0.08 * np.sin(5 * angle)
    cx, cy = x + 1.0, y + 0.82
    region = np.column_stack([cx + 0.86 * radius * np.cos(angle), cy + 0.56 * radius * np.sin(angle)])
    box = Rectangle(
        (cx - 0.52, cy - 0.44), 1.25, 0.98, fill=False, edgecolor=PURPLE, linewidth=1.6, linestyle=(0, (5, 2))
    )
    ax.add_patch(Polygon(region, closed=True, facecolor="none", edgecolor=GREEN, linewidth=1.4))
    inside = ax.add_patch(Polygon(region, closed=True, facecolor=GREEN, alpha=0.3, edgecolor="none"))
    ax.add_patch(box)
    inside.set_clip_path(box)
    ax.plot(cx + 0.1, cy + 0.05, "*", color="#000000", markersize=9)
    ax.text(cx + 0.18, cy - 0.02, "best safe", fontsize=7.5, va="top")
    ax.plot([cx - 0.2, cx + 0.45, cx - 0.05], [cy + 0.3, cy + 0.32, cy - 0.25], "o", color=BLUE, markersize=4)
    ax.text(x + width - 0.05, y + 0.85, "μ + βσ\n≥ h", fontsize=8, ha="right", va="center", color="#00694d")
    ax.text(cx + 0.1, cy - 0.58, "side l", fontsize=8, ha="center", va="center", color="#9c4c77")
