"""Curves over trials in small multiples, and the final metrics of all methods side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hdsafebo.report.data.methods import FAMILIES, by_family, style, task_label
from hdsafebo.report.data.metrics import METRIC_LABELS
from hdsafebo.report.data.paper import paper_value
from hdsafebo.report.data.results import Results
from hdsafebo.report.figures.panels import Figure, Line, Panel, plot_style
from hdsafebo.runs.series import METRICS

Y_LABELS = {
    "objective": "best safe objective ↑",
    "safety": "safe share of trials ↑",
    "violation": "cumulative violation ↓",
}
_NAMES, _NAME_HEIGHT = 0.4, 0.055
"""Width that names of points take beside the panel, and the height of one, in the panel's own."""


def curve_figures(results: Results, task: str, methods: list[str]) -> list[Figure]:
    """One figure per family of baselines, this project's methods in each: three metrics over trials."""
    limits = {metric: _limits(results, task, methods, metric) for metric in METRICS}
    known = "" if results.optimum(task) is None else " Dashed: the best safe value of the whole set."
    figures = []
    for family, names in by_family(methods).items():
        row = [_curve_panel(results, task, names, metric, limits[metric]) for metric in METRICS]
        caption = (
            f"{task_label(task)}: {FAMILIES[family]}. Mean over runs; bands are one standard error.{known}"
        )
        figures.append(Figure(f"curves_{task}_{family}", caption, [row], [style(m) for m in names]))
    return figures


def single_curve_figure(results: Results, task: str, methods: list[str], name: str, caption: str) -> Figure:
    """One figure of the given methods (an ablation)."""
    row = [_curve_panel(results, task, methods, m, _limits(results, task, methods, m)) for m in METRICS]
    return Figure(name, caption, [row], [style(m) for m in methods])


def final_figure(results: Results, task: str, methods: list[str]) -> Figure:
    """Final metrics of every method with the paper's values where it prints them."""
    row = [_final_panel(results, task, methods, metric) for metric in METRICS]
    caption = (
        f"{task_label(task)}: final values. Filled: mean and one standard error of the runs here; "
        "open diamond: the paper's value with the spread that it prints."
    )
    return Figure(f"final_{task}", caption, [row])


def front_figure(results: Results, task: str, methods: list[str]) -> Figure:
    """Return against safety of every method, so that no limit on safety hides one."""
    points = {
        m: (results.estimate(task, m, "safety"), results.estimate(task, m, "objective")) for m in methods
    }

    def draw(ax: Any) -> None:
        for method, (safety, value) in points.items():
            if not value.runs:
                continue
            look = style(method)
            ax.errorbar(
                safety.mean,
                value.mean,
                xerr=np.nan_to_num(safety.se),
                yerr=np.nan_to_num(value.se),
                fmt=look.marker,
                color=look.colour,
                markersize=6,
                elinewidth=0.8,
            )
        _name(ax, {m: (safe.mean, value.mean) for m, (safe, value) in points.items() if value.runs})
        ax.set_xlabel("safe share of trials")
        ax.set_title("best safe return over safety", loc="left")

    caption = (
        f"{task_label(task)}: best safe return against safety, every method; means and one standard error. A "
        "method is beaten when another lies above it and to its right."
    )
    title = f"{task_label(task)}: best safe return of each method over its safety"
    return Figure(f"front_{task}", caption, [[Panel(title, draw, inches=(7.4, 4.2))]])


def _name(ax: Any, points: dict[str, tuple[float, float]]) -> None:
    """Names in a column to the right of the points, each joined to its own."""
    low, high = ax.get_xlim()
    bottom, top = ax.get_ylim()
    ticks = [tick for tick in ax.get_xticks() if low <= tick <= 1.0]
    ax.set(xlim=(low, high + _NAMES * (high - low)), ylim=(bottom, top), xticks=ticks)
    order = sorted(points, key=lambda method: -points[method][1])
    heights = spread_out([(points[method][1] - bottom) / (top - bottom) for method in order], _NAME_HEIGHT)
    for method, height in zip(order, heights, strict=True):
        ax.annotate(
            style(method).label,
            points[method],
            (1.0 / (1.0 + _NAMES), height),
            textcoords="axes fraction",
            va="center",
            fontsize=7.5,
            arrowprops={"arrowstyle": "-", "color": "#888888", "linewidth": 0.6, "linestyle": ":"},
        )


def spread_out(heights: Sequence[float], gap: float) -> list[float]:
    """Heights in [0, 1], the highest first, moved as little as puts them apart by the gap, or evenly.

    Args:
        heights: from the highest to the lowest.
        gap: least distance, less where so many do not fit.
    """
    gap = min(gap, 1.0 / max(len(heights), 1))
    placed, ceiling = [], 1.0 - gap / 2
    for height in heights:
        placed.append(min(height, ceiling))
        ceiling = placed[-1] - gap
    floor = gap / 2
    for i in reversed(range(len(placed))):
        placed[i] = max(placed[i], floor)
        floor = placed[i] + gap
    return placed


def _limits(results: Results, task: str, methods: list[str], metric: str) -> tuple[float, float] | None:
    """Common limits of a row of panels, so that they can be compared."""
    low, high = [], []
    for method in methods:
        mean, error = results.series(task, method).mean_and_error(metric)
        band = np.nan_to_num(error)
        if np.isfinite(mean).any():
            low.append(float(np.nanmin(mean - band)))
            high.append(float(np.nanmax(mean + band)))
    if not low:
        return None
    margin = 0.05 * (max(high) - min(low)) or 0.05
    return min(low) - margin, max(high) + margin


def _curve_panel(
    results: Results, task: str, methods: list[str], metric: str, limits: tuple[float, float] | None
) -> Panel:
    curves = {
        m: (results.series(task, m).trials, *results.series(task, m).mean_and_error(metric)) for m in methods
    }
    optimum = results.optimum(task) if metric == "objective" else None

    def draw(ax: Any) -> None:
        for method, (trials, mean, error) in curves.items():
            look = style(method)
            known = np.isfinite(error)
            ax.fill_between(
                trials[known],
                (mean - error)[known],
                (mean + error)[known],
                color=look.colour,
                alpha=0.18,
                linewidth=0,
            )
            ax.plot(trials, mean, **plot_style(look, len(trials)))
        if optimum is not None:
            ax.axhline(optimum, color="#777777", linewidth=0.9, linestyle=(0, (2, 2)))
        if limits is not None:
            ax.set_ylim(limits[0], limits[1] if optimum is None else max(limits[1], 1.04 * optimum))
        ax.set_xlabel("trials")
        ax.set_title(Y_LABELS[metric], loc="left")

    lines = [
        Line(style(m).label, style(m).colour, trials.tolist(), mean.tolist(), error.tolist())
        for m, (trials, mean, error) in curves.items()
    ]
    return Panel(f"{task_label(task)}: {Y_LABELS[metric]} over trials", draw, lines)


def _final_panel(results: Results, task: str, methods: list[str], metric: str) -> Panel:
    estimates = [results.estimate(task, m, metric) for m in methods]
    paper = [paper_value(task, m, metric) for m in methods]

    def draw(ax: Any) -> None:
        for y, (method, ours, theirs) in enumerate(zip(methods, estimates, paper, strict=True)):
            look = style(method)
            if theirs is not None:
                ax.errorbar(
                    theirs.value,
                    y + 0.22,
                    xerr=theirs.spread,
                    fmt="D",
                    color="#777777",
                    markerfacecolor="white",
                    markersize=4.5,
                    elinewidth=0.8,
                )
            if ours.runs:
                ax.errorbar(
                    ours.mean,
                    y - 0.1,
                    xerr=0 if np.isnan(ours.se) else ours.se,
                    fmt=look.marker,
                    color=look.colour,
                    markersize=5.5,
                    capsize=2,
                )
        ax.set_yticks(range(len(methods)), [style(m).label for m in methods])
        ax.set_ylim(len(methods) - 0.4, -0.6)
        ax.set_title(f"{METRIC_LABELS[metric]} {'↓' if metric == 'violation' else '↑'}", loc="left")

    return Panel(
        f"{task_label(task)}: final {metric} of each method",
        draw,
        inches=(3.7, 0.9 + 0.24 * len(methods)),
        left=1.75,
    )
