"""Files for machines: the metrics file and the curves that `dvc plots` draws."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pandas as pd

from hdsafebo.files.atomic import write_json
from hdsafebo.report.data.inputs import Inputs
from hdsafebo.report.data.results import Results
from hdsafebo.runs.series import CURVE_NAMES, METRICS

SUMMARY_METRICS = (*METRICS, "seconds_per_round")


def summary(results: Results, inputs: Inputs, *, profile: str, git_revision: str | None) -> dict[str, Any]:
    """Metrics and run counts by task and method, the traversal, the isometry check, and where they come from.

    Numbers that are not known (the standard error of one run) are None.
    """
    found: dict[str, Any] = {"profile": profile, "git_revision": git_revision}
    for task in results.experiments + results.digit_tasks:
        found[task] = {
            method: {metric: _numbers(results, task, method, metric) for metric in SUMMARY_METRICS}
            | {"counts": results.counts(task, method).model_dump()}
            for method in results.methods(task)
        }
    if inputs.stimulation is not None:
        found["traversal"] = {"rows": inputs.stimulation.rows, "safe_share": inputs.stimulation.safe_share}
        if inputs.traversal is not None:
            found["traversal"] |= inputs.traversal.model_dump()
    if inputs.isometry is not None:
        found["isometry"] = {
            name: {key: None if value is None else _known(value) for key, value in check.model_dump().items()}
            for name, check in inputs.isometry.items()
        }
    return found


def _numbers(results: Results, task: str, method: str, metric: str) -> dict[str, float | int | None]:
    e = results.estimate(task, method, metric)
    return {"mean": _known(e.mean), "se": _known(e.se), "runs": e.runs}


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def write_summary(path: Path, content: dict[str, Any]) -> None:
    """Write JSON without NaN."""
    write_json(path, content, sort_keys=True)


def curve_table(results: Results, task: str) -> pd.DataFrame:
    """Mean curves of every method of a task: one row per method and round."""
    tables = []
    for method in results.methods(task):
        series = results.series(task, method)
        columns: dict[str, Any] = {
            "method": method,
            "round": range(len(series.trials)),
            "trials": series.trials,
        }
        for metric in METRICS:
            name = CURVE_NAMES[metric]
            columns[name], columns[f"{name}_se"] = series.mean_and_error(metric)
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)
