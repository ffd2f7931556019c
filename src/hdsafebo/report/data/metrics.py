"""The numbers of a finished run, one row per seed."""

from __future__ import annotations

import numpy as np
import pandas as pd

from hdsafebo.runs.read import RunFile

HIGHER_IS_BETTER = {
    "objective": True,
    "safety": True,
    "violation": False,
    "seconds_per_round": False,
    "improvement": True,
}
METRIC_LABELS = {
    "objective": "Objective",
    "safety": "Safety",
    "violation": "Violation",
    "seconds_per_round": "CPU seconds per round",
    "improvement": "Gain over the initial data",
}


def per_seed(run: RunFile) -> pd.DataFrame:
    """Final metrics of each run.

    Returns:
        One row per seed (index: the seed as text) with the columns
        objective: best objective among all safe trials, the initial ones included ("best feasible"),
        initial_objective: the same over the initial trials alone,
        improvement: the difference of the two,
        safety: share of safe ones among the completed trials that the method chose,
        violation: sum of max(0, h - g) over them,
        modelled_violation: the same of the functions that were modelled, as they were modelled,
        violation_bound: sum of its one-step bounds; NaN when the method has none,
        unconstrained: best objective among all completed trials, whether safe or not,
        new_points: chosen trials whose point was not tried before,
        seconds_per_round: mean CPU time that the method took to choose a batch, evaluation excluded,
        chosen, failed: numbers of chosen trials and of failed evaluations.
    """
    frame = run.trials
    chosen = run.chosen
    safe = frame[frame["safe"] & (frame["status"] == "completed")]
    by_seed = chosen.groupby("seed")
    rounds = frame[~frame["initial"]].groupby(["seed", "round"])["method_seconds"].first()
    table = pd.DataFrame(index=pd.Index(sorted(frame["seed"].unique()), name="seed"))
    table["objective"] = safe.groupby("seed")["objective"].max()
    table["initial_objective"] = safe[safe["initial"]].groupby("seed")["objective"].max()
    table["improvement"] = table["objective"] - table["initial_objective"]
    table["safety"] = by_seed["safe"].mean()
    table["violation"] = by_seed["violation"].sum()
    table["modelled_violation"] = by_seed["modelled_violation"].sum()
    table["unconstrained"] = frame[frame["status"] == "completed"].groupby("seed")["objective"].max()
    table["new_points"] = (~chosen["repeated"]).groupby(chosen["seed"]).sum()
    table["violation_bound"] = by_seed["violation_bound"].agg(lambda column: column.sum(skipna=False))
    table["seconds_per_round"] = rounds.groupby("seed").mean()
    table["chosen"] = by_seed.size()
    table["failed"] = (frame["status"] == "failed").groupby(frame["seed"]).sum()
    counts = table[["chosen", "failed"]].fillna(0).astype(np.int64)
    return table.assign(chosen=counts["chosen"], failed=counts["failed"]).rename(index=str)


def early_violation(run: RunFile, share: float) -> pd.Series:
    """Violation of each seed over the first `share` of the optimised trials."""
    chosen = run.chosen
    last = run.meta.n_initial + share * (run.meta.n_trials - run.meta.n_initial)
    return chosen[chosen["trial"] < last].groupby("seed")["violation"].sum().rename(index=str)
