"""A run as curves over its trials, for comparison in the tracking server's charts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdsafebo.runs.write import Rows

Series = dict[str, NDArray[np.float64]]


def round_series(rows: Rows) -> tuple[NDArray[np.int64], Series]:
    """State of a run after each of its k rounds.

    Returns:
        (k,) number of trials so far, and (k,) values of each metric. Safety and violation count completed
        trials that the method chose; NaN where there is nothing to count yet.
    """
    completed = rows["status"] == "completed"
    chosen = completed & ~rows["initial"]
    best = np.maximum.accumulate(np.where(completed & rows["safe"], rows["objective"], -np.inf))
    counted = np.cumsum(chosen)
    with np.errstate(invalid="ignore"):
        ratio = np.cumsum(chosen & rows["safe"]) / counted
    last = np.append(np.flatnonzero(np.diff(rows["round"])), len(completed) - 1)
    values = {
        "best_safe_objective": np.where(np.isfinite(best), best, np.nan),
        "safety_ratio": ratio,
        "cumulative_violation": np.cumsum(np.where(chosen, rows["violation"], 0.0)),
        "trust_region_length": rows["trust_region_length"],
        "seconds_per_round": rows["method_seconds"],
    }
    return last + 1, {name: column[last] for name, column in values.items()}


def mean_series(runs: list[Rows]) -> tuple[NDArray[np.int64], Series]:
    """Means over runs of what `round_series` gives, for the rounds that all of them have.

    NaN where a run has no value yet.
    """
    curves = [round_series(rows) for rows in runs]
    rounds = min(len(steps) for steps, _ in curves)
    means = {name: np.mean([series[name][:rounds] for _, series in curves], axis=0) for name in curves[0][1]}
    return curves[0][0][:rounds], means
