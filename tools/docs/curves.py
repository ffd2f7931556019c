"""Pictures of the methods, from the runs that are kept of them.

The best safe value over the number of trials, on two of the problems that others wrote or else on the paper's
synthetic task: the median of the seeds as a line, their range as a band, the medians of the other methods in
grey. The share of safe trials is a number beside the curve. A picture has its own background, light or dark.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from hdsafebo.report.data.methods import style
from hdsafebo.report.data.outside import OUTSIDE, outside_label
from hdsafebo.runs.read import RunFile, read_run
from hdsafebo.runs.series import per_round
from hdsafebo.typing import FloatArray

FOLDER = "docs/methods/curves"
EVIDENCE = "reports/reference/runs"
_PREFERRED = ("hartmann6", "ackley10")
"""Shown where there are runs on them: their values need no transformation."""
_BATCH = 5
"""Trials between two values of a run (`benchmarks/outside.py`)."""
_PANEL, _HEIGHT = 300, 250
_LEFT, _RIGHT, _TOP, _BOTTOM = 46, 18, 48, 40
_STYLE = (
    "text{font:13px system-ui,sans-serif;fill:#1b1b1b} .card{fill:#fff} .axis{fill:none;stroke:#666}"
    " .other{fill:none;stroke:#b5b5b5} .own{fill:none;stroke:#c24a00;stroke-width:2.5}"
    " .range{fill:#c24a00;opacity:.2} .optimum{stroke:#666;stroke-dasharray:2 4}"
    " @media (prefers-color-scheme:dark){text{fill:#e6e6e6} .card{fill:#16181d} .axis{stroke:#a0a0a0}"
    " .optimum{stroke:#a0a0a0} .other{stroke:#5c5c5c} .own{stroke:#ff8a3d} .range{fill:#ff8a3d}}"
)

Runs = dict[str, dict[str, dict[str, dict[str, Any]]]]
"""Runs by method, problem and seed."""


@dataclass(frozen=True)
class Panel:
    """A method on a problem.

    Attributes:
        label: of the problem.
        optimum: best value that keeps the limits; None where it is not known.
        batch: trials between two values.
        own: (seeds, n) best safe values of the method, after each batch.
        others: medians of the other methods.
        safe: share of the method's trials that was safe.
    """

    label: str
    optimum: float | None
    batch: int
    own: FloatArray
    others: tuple[FloatArray, ...]
    safe: float


def read_runs(root: Path) -> Runs:
    """All runs that are kept."""
    files = sorted((root / OUTSIDE).parent.glob("*.json"))
    known = [path for path in files if path != root / OUTSIDE]
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in known}


def read_synthetic(root: Path) -> dict[str, RunFile]:
    """Kept runs of the synthetic task by method; those of its variants have other names."""
    runs = (read_run(path) for path in sorted((root / EVIDENCE).glob("synthetic-*.parquet")))
    return {run.meta.method: run for run in runs if run.meta.method == run.meta.algorithm}


def write(root: Path, names: Sequence[str]) -> dict[str, str]:
    """Pictures of those of the methods `names` that have runs, by path below the project's root."""
    return {
        f"{FOLDER}/{name}.svg": _drawing(name, drawn) for name in names if (drawn := panels_of(root, name))
    }


def panels_of(root: Path, name: str) -> list[Panel]:
    """What is drawn of a method; nothing without runs."""
    runs = read_runs(root)
    if name in runs:
        return panels(runs, json.loads((root / OUTSIDE).read_text(encoding="utf-8")), name)
    synthetic = read_synthetic(root)
    return [synthetic_panel(synthetic, name)] if name in synthetic else []


def synthetic_panel(runs: dict[str, RunFile], name: str) -> Panel:
    """A method on the synthetic task."""
    values = {method: per_round(run.trials).objective for method, run in runs.items()}
    length = min(array.shape[1] for array in values.values())
    others = (np.nanmedian(array[:, :length], axis=0) for method, array in values.items() if method != name)
    return Panel(
        "Synthetic task of the paper",
        None,
        runs[name].meta.batch,
        values[name][:, :length],
        tuple(others),
        float(runs[name].chosen["safe"].mean()),
    )


def panels(runs: Runs, table: dict[str, dict[str, Any]], name: str) -> list[Panel]:
    """One or two problems that a method has runs on."""
    own = runs[name]
    chosen = [*(p for p in _PREFERRED if p in own), *(p for p in sorted(own) if p not in _PREFERRED)][:2]
    return [
        Panel(
            outside_label(problem),
            next(iter(table[problem].values()))["optimum"],
            _BATCH,
            _values(own[problem]),
            tuple(
                np.median(_values(other[problem]), axis=0)
                for method, other in runs.items()
                if method != name and problem in other
            ),
            float(np.mean([run["safe"] for run in own[problem].values()])),
        )
        for problem in chosen
    ]


def shown(root: Path, name: str) -> list[str]:
    """What the page of a method says of its picture; that there is none without runs."""
    drawn = panels_of(root, name)
    if not drawn:
        return ["## Measured", "No runs of it are kept."]
    reached = "; ".join(
        f"on {panel.label.split(',')[0]} the median rises from "
        f"{np.median(panel.own[:, 0]):.3g} to "
        f"{np.median(panel.own[:, -1]):.3g}{_optimum(panel)}, and "
        f"{panel.safe * 100:.0f} % of the trials are safe"
        for panel in drawn
    )
    alternative = f"Best safe value of {style(name).label} over the number of trials: {reached}."
    seeds = len(drawn[0].own)
    where = (
        "The [synthetic task](../reproduction/results.md)"
        if drawn[0].optimum is None
        else "Two of the [problems that others wrote](../reproduction/results.md#problems-that-others-wrote)"
    )
    known = "" if drawn[0].optimum is None else ", the optimum dotted"
    caption = (
        f"{where}: median of {seeds} seeds as a line, their range as a band, medians of the other methods in "
        f"grey{known}; higher is better."
    )
    return ["## Measured", f"![{alternative}](curves/{name}.svg)", caption]


def _optimum(panel: Panel) -> str:
    return "" if panel.optimum is None else f" (optimum {panel.optimum:.3g})"


def _values(seeds: dict[str, dict[str, Any]]) -> FloatArray:
    """(seeds, n) best safe values, as far as all runs go."""
    length = min(len(run["best"]) for run in seeds.values())
    return np.array([run["best"][:length] for run in seeds.values()], np.float64)


def _drawing(name: str, drawn: list[Panel]) -> str:
    width = _PANEL * len(drawn)
    title = escape(f"Best safe value of {style(name).label} over the number of trials")
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {_HEIGHT}" width="{width}" '
        f'height="{_HEIGHT}" role="img">\n<title>{title}</title>\n<style>{_STYLE}</style>\n'
        f'<rect class="card" width="{width}" height="{_HEIGHT}" rx="6"/>\n'
    )
    return head + "".join(_panel(panel, i * _PANEL) for i, panel in enumerate(drawn)) + "</svg>\n"


def _panel(panel: Panel, offset: int) -> str:
    trials = panel.batch * (panel.own.shape[1] - 1)
    every = [
        panel.own.ravel(),
        *panel.others,
        *([] if panel.optimum is None else [np.array([panel.optimum])]),
    ]
    low, high = float(np.concatenate(every).min()), float(np.concatenate(every).max())
    low, high = low - 0.04 * (high - low), high + 0.04 * (high - low)
    left, right = offset + _LEFT, offset + _PANEL - _RIGHT
    top, bottom = _TOP, _HEIGHT - _BOTTOM

    def across(trial: float) -> float:
        return left + (right - left) * trial / trials

    def up(value: float) -> float:
        return bottom - (bottom - top) * (value - low) / (high - low)

    def points(values: FloatArray, first: int = 0) -> str:
        order = range(len(values)) if not first else range(len(values) - 1, -1, -1)
        return " ".join(f"{across(panel.batch * i):.1f},{up(values[i]):.1f}" for i in order)

    parts = [
        f'<text x="{offset + 8}" y="19">{escape(panel.label)}</text>',
        f'<text x="{offset + 8}" y="37">{panel.safe * 100:.0f} % of the trials safe</text>',
        f'<path class="axis" d="M{left} {top}V{bottom}H{right}"/>',
    ]
    if panel.optimum is not None:
        parts.append(f'<path class="optimum" d="M{left} {up(panel.optimum):.1f}H{right}"/>')
    parts += [f'<polyline class="other" points="{points(other)}"/>' for other in panel.others]
    ends = f"{points(panel.own.max(axis=0))} {points(panel.own.min(axis=0), first=1)}"
    parts += [
        f'<polygon class="range" points="{ends}"/>',
        f'<polyline class="own" points="{points(np.median(panel.own, axis=0))}"/>',
    ]
    parts += [
        f'<text text-anchor="end" x="{left - 6}" y="{up(value) + 4:.1f}">{_minus(value)}</text>'
        for value in _ticks(low, high)
    ]
    parts += [
        f'<text text-anchor="middle" x="{across(trial):.1f}" y="{bottom + 17}">{trial:g}</text>'
        for trial in (0, trials // 2, trials)
    ]
    parts.append(f'<text text-anchor="middle" x="{(left + right) / 2:.1f}" y="{bottom + 34}">trial</text>')
    return "\n".join(parts) + "\n"


def _minus(value: float) -> str:
    return f"{value:g}".replace("-", "\N{MINUS SIGN}")


def _ticks(low: float, high: float) -> list[float]:
    """Three to six round numbers between two."""
    rough = (high - low) / 4
    unit = 10.0 ** np.floor(np.log10(rough))
    step = next(unit * factor for factor in (1, 2, 5, 10) if unit * factor >= rough)
    return [
        float(np.round(i * step, 12)) for i in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)
    ]
