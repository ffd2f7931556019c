"""What came of the trials, one after another."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdsafebo.plots.style import LINE, UNSAFE, done, labelled, mark_trials, new_figure
from hdsafebo.system.study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def progress(study: Study) -> Figure:
    """The objective of each trial, the best safe one so far, and each limited quantity with its limits."""
    system, table = study.system, done(study.to_dataframe())
    limits = system.limits
    figure = new_figure(7.0, 2.6 + 1.5 * len(limits))
    panels = figure.subplots(1 + len(limits), 1, sharex=True, height_ratios=[1.6, *[1.0] * len(limits)])
    panels = np.atleast_1d(panels)
    sign = system.objective.sign
    safe = sign * table[system.objective.name].where(table["safe"])
    mark_trials(panels[0], table, table.index, table[system.objective.name])
    panels[0].step(table.index, sign * safe.cummax().ffill(), where="post", color=LINE, label="best safe")
    panels[0].legend(frameon=False, fontsize="small", ncols=4)
    panels[0].set_ylabel(labelled(system.objective))
    for axes, limit in zip(panels[1:], limits, strict=True):
        mark_trials(axes, table, table.index, table[limit.name], size=16)
        for value, where in ((limit.at_least, "at least"), (limit.at_most, "at most")):
            if value is not None:
                axes.axhline(value, color=UNSAFE, linestyle="--", linewidth=1.2, label=f"{where} {value:g}")
        axes.legend(*_lines(axes), frameon=False, fontsize="small")
        axes.set_ylabel(labelled(limit))
    panels[-1].set_xlabel("trial")
    return figure


def _lines(axes):  # type: ignore[no-untyped-def]
    """Legend entries of the limits only."""
    handles, labels = axes.get_legend_handles_labels()
    kept = [(h, text) for h, text in zip(handles, labels, strict=True) if text.startswith("at ")]
    return [h for h, _ in kept], [text for _, text in kept]
