"""What the figures share: colours that all readers tell apart, labels with units, marks of trials."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hdsafebo.system.outcomes import Limit, Objective
from hdsafebo.system.parameters import Fixed, Parameter
from hdsafebo.system.study import Study

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SAFE, UNSAFE, FAILED, LINE, BAND = "#0072B2", "#D55E00", "#7F7F7F", "#222222", "#0072B2"
_MARKS = {"safe": ("o", SAFE), "unsafe": ("X", UNSAFE), "failed": ("v", FAILED)}


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, in inches; it belongs to no window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained", dpi=110)


def labelled(part: Parameter | Objective | Limit) -> str:
    """Name and unit."""
    return part.name + (f" ({part.unit})" if part.unit else "")


def varying(study: Study) -> list[Parameter]:
    """The parameters that can be chosen."""
    return [p for p in study.system.parameters if not isinstance(p, Fixed)]


def done(table: pd.DataFrame) -> pd.DataFrame:
    """Trials with results, with the column `outcome`: safe, unsafe or failed."""
    table = table[table["status"] != "pending"].copy()
    table["outcome"] = table["safe"].map({True: "safe", False: "unsafe"})
    table.loc[table["status"] == "failed", "outcome"] = "failed"
    return table


def mark_trials(
    axes: Axes, table: pd.DataFrame, x: Any, y: Any, *, legend: bool = False, size: float = 26
) -> None:
    """Mark trials: safe ones by circles (hollow when they were there before the first suggestion).

    Args:
        axes: where.
        table: from `done`.
        x, y: one value per row.
        legend: name the marks.
        size: of a mark, in square points.
    """
    x, y = list(x), list(y)
    for outcome, (marker, colour) in _MARKS.items():
        for initial in (True, False):
            which = ((table["outcome"] == outcome) & (table["initial"] == initial)).to_numpy()
            if not which.any():
                continue
            axes.scatter(
                [v for v, w in zip(x, which, strict=True) if w],
                [v for v, w in zip(y, which, strict=True) if w],
                s=size,
                marker=marker,
                facecolors="white" if initial and outcome == "safe" else colour,
                edgecolors=colour if outcome == "safe" else "white",
                linewidths=0.8,
                label=f"{outcome}{', before' if initial else ''}",
                zorder=3,
            )
    if legend:
        axes.legend(frameon=False, fontsize="small")
