"""Whether what was believed of safety came true."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdsafebo.plots.style import LINE, SAFE, done, new_figure
from hdsafebo.system.study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_EDGES = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
_NINETY_FIVE = 1.96


def calibration(study: Study) -> Figure:
    """Predicted safe probability of the suggestions against the share that was safe, with 95 % intervals.

    Failed trials count as unsafe where failures teach; numbers of trials stand above the points.
    """
    table = done(study.to_dataframe())
    table = table[~table["initial"] & table["safe_probability"].notna()]
    if study.system.failures == "ignored":
        table = table[table["outcome"] != "failed"]
    figure = new_figure(4.2, 3.9)
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color=LINE, linewidth=0.8, linestyle=":")
    predicted = table["safe_probability"].to_numpy()
    safe = (table["outcome"] == "safe").to_numpy()
    bins = np.clip(np.searchsorted(_EDGES, predicted, side="right") - 1, 0, len(_EDGES) - 2)
    for number in np.unique(bins):
        inside = bins == number
        n, share = int(inside.sum()), float(safe[inside].mean())
        low, high = wilson(share, n)
        x = float(predicted[inside].mean())
        axes.errorbar(x, share, yerr=[[share - low], [high - share]], color=SAFE, marker="o", capsize=3)
        axes.annotate(
            str(n), (x, high), textcoords="offset points", xytext=(0, 4), ha="center", fontsize="small"
        )
    axes.set(
        xlabel="predicted safe probability",
        ylabel="share that was safe",
        xlim=(-0.03, 1.03),
        ylim=(-0.03, 1.1),
    )
    axes.set_title(f"{len(table)} suggestions", fontsize="medium")
    return figure


def wilson(share: float, n: int) -> tuple[float, float]:
    """The 95 % interval of a share of n (Wilson, 1927)."""
    z2 = _NINETY_FIVE**2
    centre = (share + z2 / (2 * n)) / (1 + z2 / n)
    half = _NINETY_FIVE * np.sqrt(share * (1 - share) / n + z2 / (4 * n * n)) / (1 + z2 / n)
    return max(0.0, min(share, centre - half)), min(1.0, max(share, centre + half))
