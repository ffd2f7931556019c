"""Per-round curves of a run file: best safe objective, safe share, cumulative violation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hdsafebo.runs.read import RunFile

FloatArray = NDArray[np.float64]
METRICS = ("objective", "safety", "violation")


@dataclass(frozen=True)
class Series:
    """Curves of S units (seeds, or tasks averaged over their seeds) over rounds 0..R.

    Attributes:
        units: names of the S units.
        trials: (R+1,) mean number of trials at the end of each round; round 0 is the initial data.
        objective: (S, R+1) best objective among the safe trials so far, initial ones included; NaN
            before the first.
        safety: (S, R+1) share of safe ones among the optimised trials so far; NaN in round 0.
        violation: (S, R+1) sum of violations of the optimised trials so far.
    """

    units: tuple[str, ...]
    trials: FloatArray
    objective: FloatArray
    safety: FloatArray
    violation: FloatArray

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


def per_round(run: RunFile) -> Series:
    """Curves of every seed of a run file.

    A seed that ended early (its method abstained) keeps its last values.
    """
    frame = run.trials
    done = frame["status"] == "completed"
    optimised = done & ~frame["initial"]
    columns = pd.DataFrame(
        {
            "seed": frame["seed"],
            "round": frame["round"],
            "best": frame["objective"].where(done & frame["safe"], -np.inf),
            "trials": 1.0,
            "optimised": optimised.astype(float),
            "safe": (frame["safe"] & optimised).astype(float),
            "violation": frame["violation"].where(optimised, 0.0),
        }
    )
    rounds = columns.groupby(["seed", "round"]).agg(
        best=("best", "max"),
        trials=("trials", "sum"),
        optimised=("optimised", "sum"),
        safe=("safe", "sum"),
        violation=("violation", "sum"),
    )
    numbers = range(int(frame["round"].max()) + 1)

    def table(name: str, missing: float) -> FloatArray:
        """(S, R+1) values of one column."""
        wide = rounds[name].unstack("round").reindex(columns=numbers)
        return wide.fillna(missing).to_numpy(float)

    best = np.maximum.accumulate(table("best", -np.inf), axis=1)
    count, safe = table("optimised", 0.0).cumsum(axis=1), table("safe", 0.0).cumsum(axis=1)
    with np.errstate(invalid="ignore"):
        safety = np.where(count > 0, safe / np.maximum(count, 1), np.nan)
    return Series(
        units=tuple(str(seed) for seed in sorted(frame["seed"].unique())),
        trials=table("trials", 0.0).cumsum(axis=1).mean(axis=0),
        objective=np.where(np.isfinite(best), best, np.nan),
        safety=safety,
        violation=table("violation", 0.0).cumsum(axis=1),
    )


def pool(parts: dict[str, Series]) -> Series:
    """One unit per part: each part's mean over its own units (digits: a unit is a digit).

    Parts of different length are cut to the shortest.
    """
    length = min(len(part.trials) for part in parts.values())
    means = {m: np.stack([part.mean_and_error(m)[0][:length] for part in parts.values()]) for m in METRICS}
    trials = np.mean([part.trials[:length] for part in parts.values()], axis=0)
    return Series(tuple(parts), trials, means["objective"], means["safety"], means["violation"])
