"""Read run files with pandas: metrics per seed, a paired comparison, a learning curve.

`data/runs/<task>-<method>.parquet` has a row per trial (columns: seed, trial, round, initial, objective,
safety, safe, violation, predicted_safe_probability, method_seconds, status, the searched point z, ...) and
says in its metadata how it was run. Nothing of hdsafebo is needed to read it.

    python examples/read_runs.py data/runs synthetic hdsafebo sobol
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq


def read_run(folder: Path, task: str, method: str) -> pd.DataFrame:
    """One row per trial; what the file says about itself is in `attrs`."""
    path = folder / f"{task}-{method}.parquet"
    table = pd.read_parquet(path)
    table.attrs = json.loads(pq.read_schema(path).metadata[b"hdsafebo"])
    return table


def per_seed(run: pd.DataFrame) -> pd.DataFrame:
    """The paper's metrics by seed: initial trials count in the objective, not in safety and violation."""
    done = run[run["status"] == "completed"]
    chosen = done[~done["initial"]].groupby("seed")
    return pd.DataFrame(
        {
            "objective": done[done["safe"]].groupby("seed")["objective"].max(),
            "safety": chosen["safe"].mean(),
            "violation": chosen["violation"].sum(),
        }
    )


def learning_curve(run: pd.DataFrame) -> pd.DataFrame:
    """Best safe objective so far by trial: mean and standard error over seeds."""
    safe = run["objective"].where(run["safe"])
    best = safe.groupby(run["seed"]).cummax().groupby(run["seed"]).ffill()
    by_trial = best.groupby(run["trial"])
    return pd.DataFrame({"mean": by_trial.mean(), "standard_error": by_trial.sem()})


def paired_difference(first: pd.DataFrame, second: pd.DataFrame, metric: str) -> tuple[float, float, int]:
    """Mean difference over common seeds, its standard error, and their number.

    At one seed all methods meet the same problem and the same initial trials: look at differences.
    """
    difference = (first[metric] - second[metric]).dropna()
    error = difference.std(ddof=1) / np.sqrt(len(difference))
    return float(difference.mean()), float(error), len(difference)


def main(folder: Path, task: str, methods: list[str]) -> None:
    """Print metrics of each method and the difference of the first to each other one."""
    runs = {method: read_run(folder, task, method) for method in methods}
    metrics = {method: per_seed(run) for method, run in runs.items()}
    for method, table in metrics.items():
        about = runs[method].attrs
        size = f"{len(about['seeds'])} seeds, {about['n_trials']} trials"
        print(f"\n{task} {method}: {size}, beta {about['beta']}")
        print(table.agg(["mean", "sem"]).round(3).to_string())
        print(learning_curve(runs[method]).iloc[:: max(1, about["n_trials"] // 5)].round(3).to_string())
    first, *others = methods
    for other in others:
        mean, error, pairs = paired_difference(metrics[first], metrics[other], "objective")
        print(f"\nobjective of {first} over {other}: {mean:+.3f} +- {error:.3f} ({pairs} common seeds)")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], sys.argv[3:])
