"""Final metrics against the scalar beta of the confidence bound, and seconds per round."""

from __future__ import annotations

from typing import Any

import numpy as np

from hdsafebo.report.data.methods import style, task_label
from hdsafebo.report.data.metrics import METRIC_LABELS
from hdsafebo.report.data.paper import paper_value
from hdsafebo.report.data.results import Results
from hdsafebo.report.figures.panels import Figure, Line, Panel
from hdsafebo.runs.series import METRICS


def beta_figure(results: Results, task: str, methods: dict[float, str]) -> Figure:
    """Final metrics over beta; `methods` maps beta to the method that was run with it."""
    row = [_beta_panel(results, task, methods, metric) for metric in METRICS]
    caption = (
        f"{task_label(task)}: final metrics over the scalar β of the bound μ + "
        "βσ. Mean and one standard error."
    )
    return Figure(f"beta_{task}", caption, [row])


def _beta_panel(results: Results, task: str, methods: dict[float, str], metric: str) -> Panel:
    betas = sorted(methods)
    values = [results.estimate(task, methods[b], metric) for b in betas]
    means, errors = [v.mean for v in values], [v.se for v in values]
    positions = [float(k) for k in range(len(betas))]

    def draw(ax: Any) -> None:
        ax.errorbar(positions, means, yerr=np.nan_to_num(errors), fmt="o-", color="#000000", capsize=2)
        ax.set_xticks(positions, [f"{b:g}" for b in betas])
        ax.set_xlabel("β")
        ax.set_title(f"{METRIC_LABELS[metric]} {'↓' if metric == 'violation' else '↑'}", loc="left")

    return Panel(
        f"{task_label(task)}: {metric} over beta",
        draw,
        [Line(metric, "#000000", positions, list(means), list(errors))],
    )


def seconds_figure(results: Results, tasks: list[str]) -> Figure:
    """Seconds that each method takes to choose a batch, one panel per task, on a logarithmic axis."""
    panels = [_seconds_panel(results, task) for task in tasks]
    caption = (
        "CPU seconds per round that a method takes to choose its batch, not to evaluate it. Filled: here; "
        "open diamond: the paper, on its machine."
    )
    return Figure("seconds_per_round", caption, [panels[i : i + 3] for i in range(0, len(panels), 3)])


def _seconds_panel(results: Results, task: str) -> Panel:
    methods = results.methods(task)
    values = [results.estimate(task, m, "seconds_per_round") for m in methods]
    paper = [paper_value(task, m, "seconds_per_round") for m in methods]

    def draw(ax: Any) -> None:
        ax.set_xscale("log")
        for y, (method, value, theirs) in enumerate(zip(methods, values, paper, strict=True)):
            if theirs is not None:
                ax.plot(theirs.value, y + 0.2, "D", color="#777777", markerfacecolor="white", markersize=4.5)
            if value.runs and value.mean > 0:
                ax.plot(value.mean, y - 0.1, style(method).marker, color=style(method).colour, markersize=5.5)
        ax.set_yticks(range(len(methods)), [style(m).label for m in methods])
        ax.set_ylim(len(methods) - 0.4, -0.6)
        seconds = [v.mean for v in values if v.runs and v.mean > 0] + [
            p.value for p in paper if p is not None
        ]
        if seconds:
            ax.set_xlim(
                10 ** np.floor(np.log10(0.9 * min(seconds))), 10 ** np.ceil(np.log10(1.1 * max(seconds)))
            )
        ax.xaxis.set_major_formatter("{x:g}")
        ax.xaxis.set_minor_formatter("")
        ax.set_xlabel("CPU seconds per round")
        ax.set_title(task_label(task), loc="left")

    return Panel(
        f"{task_label(task)}: seconds per round of each method",
        draw,
        inches=(3.7, 0.9 + 0.24 * len(methods)),
        left=1.75,
    )
