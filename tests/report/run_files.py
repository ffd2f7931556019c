"""Writes run files with known content."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

METADATA = {
    "profile": "test",
    "settings": {},
    "safety_names": ["safety"],
    "thresholds": [0.0],
    "beta": None,
    "guaranteed_alpha": None,
    "optimum": None,
    "space": "latent",
    "dimension": 2,
}
NO_FAULTS = {"fits": 0, "jitters": 0, "fallbacks": 0, "marked": 0, "missing": 0, "abstained": None}


def counts_of(missing: int) -> dict[str, Any]:
    """Counts of a run that lacks trials of its budget, which only an abstention explains."""
    return NO_FAULTS | {"missing": missing, "abstained": "no point is believed safe" if missing else None}


def trial_table(
    seed: int,
    objective: Sequence[float],
    safety: Sequence[float],
    *,
    n_initial: int,
    batch: int,
    seconds: float = 0.5,
    probability: float | NDArray[np.float64] = np.nan,
    bound: float = np.nan,
    threshold: float = 0.0,
    repeated: Sequence[bool] | None = None,
) -> pd.DataFrame:
    """One run: objective and safety of every trial; a trial with NaN objective failed."""
    n = len(objective)
    trial = np.arange(n)
    f, g = np.asarray(objective, float), np.asarray(safety, float)
    initial = trial < n_initial
    chosen = np.where(initial, np.nan, 1.0)
    return pd.DataFrame(
        {
            "seed": np.full(n, seed, np.int32),
            "trial": trial.astype(np.int32),
            "round": np.where(initial, 0, 1 + (trial - n_initial) // batch).astype(np.int32),
            "initial": initial,
            "objective": f,
            "safety": np.where(np.isnan(f), np.nan, g),
            "safe": (g >= threshold) & ~np.isnan(f),
            "violation": np.where(np.isnan(f), np.nan, np.maximum(0.0, threshold - g)),
            "modelled_violation": np.where(np.isnan(f), np.nan, np.maximum(0.0, threshold - g)),
            "predicted_safe_probability": probability * chosen,
            "violation_bound": bound * chosen,
            "trust_region_length": np.full(n, np.nan),
            "method_seconds": np.where(initial, 0.0, seconds),
            "evaluate_seconds": np.full(n, 0.1),
            "status": np.where(np.isnan(f), "failed", "completed"),
            "marked_unsafe": np.zeros(n, bool),
            "repeated": np.zeros(n, bool) if repeated is None else np.asarray(repeated, bool),
            "candidate": np.full(n, -1, np.int64),
        }
    )


def write_run(
    root: Path,
    task: str,
    method: str,
    tables: Sequence[pd.DataFrame],
    *,
    n_initial: int,
    batch: int,
    z: Sequence[Sequence[float]] | None = None,
    **metadata: object,
) -> Path:
    """Write `data/runs/<task>-<method>.parquet` below `root`.

    Trials that a run lacks against the longest one are missing in its counts. `counts` that are given decide
    what the budget was, and how many trials of a run were marked: the first that it chose.
    """
    frame = pd.concat(tables, ignore_index=True)
    seeds = sorted(frame["seed"].unique().tolist())
    lengths = frame.groupby("seed")["trial"].max() + 1
    n_trials = int(lengths.max())
    sizes = {"seeds": seeds, "n_initial": n_initial, "batch": batch, "n_trials": n_trials}
    sizes["counts"] = [counts_of(n_trials - int(lengths[seed])) for seed in seeds]
    if given := cast(list[dict[str, Any]], metadata.get("counts")):
        sizes["n_trials"] = int(lengths[seeds[0]]) + given[0]["missing"]
        for seed, counts in zip(seeds, given, strict=False):
            chosen = frame.index[(frame["seed"] == seed) & ~frame["initial"]]
            frame.loc[chosen[: counts["marked"]], "marked_unsafe"] = True
    content = METADATA | {"task": task, "method": method, "algorithm": method} | sizes | metadata
    table = pa.Table.from_pandas(frame, preserve_index=False)
    searched = [[0.0, 1.0]] * len(frame) if z is None else z
    table = table.append_column("z", pa.array(searched, pa.list_(pa.float32())))
    path = root / "data/runs" / f"{task}-{method}.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table.replace_schema_metadata({b"hdsafebo": json.dumps(content).encode()}), path)
    return path


def random_runs(
    root: Path,
    task: str,
    method: str,
    *,
    seeds: int,
    n_initial: int,
    n_trials: int,
    batch: int,
    gain: float,
    safe_share: float,
    rng: np.random.Generator,
    **metadata: object,
) -> Path:
    """Runs whose best value rises by about `gain` and whose trials are safe with probability `safe_share`."""
    tables = []
    for seed in range(seeds):
        share = np.clip((np.arange(n_trials) - n_initial) / (n_trials - n_initial), 0, 1)
        objective = rng.normal(0, 0.4, n_trials) + gain * (1 - np.exp(-3 * share)) * rng.uniform(0.85, 1.15)
        probability = np.clip(rng.beta(8 * safe_share, 8 * (1 - safe_share), n_trials), 0.001, 0.999)
        g = np.where(rng.uniform(size=n_trials) < probability, 1.0, -1.0) * np.abs(
            rng.normal(0.3, 0.2, n_trials)
        )
        seconds = float(np.exp(rng.normal(-1 + gain / 3, 0.1)))
        known = probability if metadata.get("beta") is not None else np.nan
        bound = 0.05 if metadata.get("beta") is not None else np.nan
        tables.append(
            trial_table(
                seed,
                objective,
                g,
                n_initial=n_initial,
                batch=batch,
                seconds=seconds,
                probability=known,
                bound=bound,
            )
        )
    return write_run(root, task, method, tables, n_initial=n_initial, batch=batch, **metadata)
