"""A run as curves over its trials, for comparison in the tracking server's charts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdsafebo.campaign.run_file import Rows

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


def final_metrics(runs: list[Rows]) -> dict[str, float]:
    """Means over runs of the last state of each, and of the seconds per round."""
    ends: dict[str, list[float]] = {}
    for rows in runs:
        _, series = round_series(rows)
        for name, values in series.items():
            value = np.mean(values[1:]) if name == "seconds_per_round" and len(values) > 1 else values[-1]
            ends.setdefault(name, []).append(float(value))
    return {name: float(np.mean(values)) for name, values in ends.items()}
