"""Calibration of predicted safety, and violation bounds beside violations."""

from __future__ import annotations

from typing import Any

from hdsafebo.report.data.methods import style, task_label
from hdsafebo.report.figures.panels import Figure, Line, Panel
from hdsafebo.report.stats.calibration import Calibration


def calibration_figure(task: str, calibrations: dict[str, Calibration]) -> Figure:
    """Predicted against observed safe probability, one panel per method, three in a row."""
    panels = [_panel(task, method, calibration) for method, calibration in calibrations.items()]
    rows = [panels[i : i + 3] for i in range(0, len(panels), 3)]
    caption = (
        f"{task_label(task)}: safe probability predicted when a trial was asked, against the observed safe "
        "share. On the diagonal the predictions are true. Bars are exact binomial intervals; grey columns "
        "show how many trials fell into each bin (largest bin = full scale of the lower fifth)."
    )
    return Figure(f"calibration_{task}", caption, rows)


def _panel(task: str, method: str, calibration: Calibration) -> Panel:
    bins, look = calibration.bins, style(method)
    x, y = bins["predicted"].to_numpy(), bins["observed"].to_numpy()
    low, high = (y - bins["observed_low"]).clip(lower=0), (bins["observed_high"] - y).clip(lower=0)

    def draw(ax: Any) -> None:
        ax.bar(
            bins["low"],
            0.2 * bins["trials"] / bins["trials"].max(),
            width=bins["high"] - bins["low"],
            align="edge",
            color="#dddddd",
            zorder=1,
        )
        ax.plot([0, 1], [0, 1], color="#777777", linewidth=0.9, linestyle=(0, (2, 2)))
        ax.errorbar(
            x, y, yerr=[low, high], fmt=look.marker, color=look.colour, capsize=2, markersize=5, zorder=3
        )
        ax.set_xlim(-0.02, 1.02)
        ax.set_ylim(-0.02, 1.05)
        ax.set_xlabel("predicted safe probability")
        ax.set_title(f"{look.label}: observed safe share", loc="left")

    lines = [Line("observed", look.colour, x.tolist(), y.tolist(), [None] * len(bins))]
    return Panel(
        f"{task_label(task)}, {look.label}: calibration of predicted safety", draw, lines, (3.7, 3.0)
    )
