"""Curves of runs over their rounds, for the report, for `dvc plots` and for the tracking server's charts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from hdsafebo.runs.schema import Rows
from hdsafebo.typing import FloatArray

METRICS = ("objective", "safety", "violation")
CURVE_NAMES = {
    "objective": "best_safe_objective",
    "safety": "safety_ratio",
    "violation": "cumulative_violation",
    "region_length": "trust_region_length",
    "seconds": "seconds_per_round",
}
"""Curves and their names in files and charts."""
_COLUMNS = [
    "seed", "round", "initial", "objective", "safe", "violation", "trust_region_length", "method_seconds",
    "status",
]  # fmt: skip


@dataclass(frozen=True)
class Series:
    """Curves of S units (seeds, or tasks averaged over their seeds) over rounds 0..R.

    Attributes:
        units: names of the S units.
        trials: (R+1,) mean number of trials at the end of each round; round 0 is the initial data.
        objective: (S, R+1) best objective among the safe trials so far, initial ones included; NaN
            before the first.
        safety: (S, R+1) share of safe trials among those that the method chose so far; NaN in round 0.
        violation: (S, R+1) sum of violations of the trials that the method chose so far.
        region_length: (S, R+1) side of the trust region at the end of each round; NaN without one.
        seconds: (S, R+1) time that the method took in each round.
    """

    units: tuple[str, ...]
    trials: FloatArray
    objective: FloatArray
    safety: FloatArray
    violation: FloatArray
    region_length: FloatArray
    seconds: FloatArray

    def mean_and_error(self, metric: str) -> tuple[FloatArray, FloatArray]:
        """(R+1,) mean and standard error over the units that have a value in that round."""
        values: FloatArray = getattr(self, metric)
        known = np.isfinite(values)
        n = known.sum(axis=0)
        total = np.where(known, values, 0.0).sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = total / n
            spread = np.where(known, (values - mean) ** 2, 0.0).sum(axis=0) / (n - 1)
            error = np.sqrt(spread / n)
        return mean, np.where(n > 1, error, np.nan)

    def mean_curves(self) -> dict[str, list[float]]:
        """The mean of every curve over the units, R+1 values each, under the names of charts."""
        return {name: self.mean_and_error(metric)[0].tolist() for metric, name in CURVE_NAMES.items()}


def per_round(trials: pd.DataFrame) -> Series:
    """Curves of every seed of a run file.

    A seed that ended early (its method abstained) keeps its last values.

    Args:
        trials: the rows of a run file.
    """
    completed = trials["status"] == "completed"
    chosen = completed & ~trials["initial"]
    columns = pd.DataFrame(
        {
            "seed": trials["seed"],
            "round": trials["round"],
            "best": trials["objective"].where(completed & trials["safe"], -np.inf),
            "trials": 1.0,
            "chosen": chosen.astype(float),
            "safe": (trials["safe"] & chosen).astype(float),
            "violation": trials["violation"].where(chosen, 0.0),
            "region_length": trials["trust_region_length"],
            "seconds": trials["method_seconds"],
        }
    )
    # The last row has the region's length after the round; the time stands in all rows alike.
    how = dict.fromkeys(("trials", "chosen", "safe", "violation"), "sum") | {"best": "max"}
    how |= dict.fromkeys(("region_length", "seconds"), "last")
    rounds = columns.groupby(["seed", "round"]).agg(how)
    numbers = range(int(trials["round"].max()) + 1)

    def table(name: str, missing: float) -> FloatArray:
        """(S, R+1) values of one column."""
        wide = rounds[name].unstack("round").reindex(columns=numbers)
        return wide.fillna(missing).to_numpy(float)

    best = np.maximum.accumulate(table("best", -np.inf), axis=1)
    count, safe = table("chosen", 0.0).cumsum(axis=1), table("safe", 0.0).cumsum(axis=1)
    with np.errstate(invalid="ignore"):
        safety = np.where(count > 0, safe / np.maximum(count, 1), np.nan)
    return Series(
        units=tuple(str(seed) for seed in sorted(trials["seed"].unique())),
        trials=table("trials", 0.0).cumsum(axis=1).mean(axis=0),
        objective=np.where(np.isfinite(best), best, np.nan),
        safety=safety,
        violation=table("violation", 0.0).cumsum(axis=1),
        region_length=table("region_length", np.nan),
        seconds=table("seconds", np.nan),
    )


def per_round_of(runs: Sequence[Rows]) -> Series:
    """Curves of runs that are not yet in a file; see `per_round`."""
    return per_round(pd.concat([pd.DataFrame({name: rows[name] for name in _COLUMNS}) for rows in runs]))


def pool(parts: dict[str, Series]) -> Series:
    """One unit per part: each part's mean over its own units (digits: a unit is a digit).

    Parts of different length are cut to the shortest.
    """
    length = min(len(part.trials) for part in parts.values())
    trials = np.mean([part.trials[:length] for part in parts.values()], axis=0)
    curves = {
        name: np.stack([part.mean_and_error(name)[0][:length] for part in parts.values()])
        for name in CURVE_NAMES
    }
    return Series(tuple(parts), trials, **curves)
