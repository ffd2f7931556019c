"""Run files: one parquet per task and method, one row per trial, checked when read."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from pydantic import BaseModel, ConfigDict, ValidationError

from hdsafebo.errors import DatasetError
from hdsafebo.files.parquet import read_parquet

METADATA_KEY = b"hdsafebo"
_INTEGERS = ("seed", "trial", "round")
_BOOLEANS = ("initial", "safe", "marked_unsafe")
_NUMBERS = (
    "objective",
    "safety",
    "violation",
    "predicted_safe_probability",
    "violation_bound",
    "trust_region_length",
    "method_seconds",
    "evaluate_seconds",
)
_COLUMNS = (*_INTEGERS, *_BOOLEANS, *_NUMBERS, "status")


class RunCounts(BaseModel):
    """What went wrong without ending a run, see `campaign.run_file.RunCounts`; sums where runs are pooled.

    Attributes:
        fits: Gaussian processes that rounds were asked with.
        jitters: fits that needed a larger diagonal than the noise.
        fallbacks: fits that failed, so that the last good hyper-parameters were kept.
        marked: trials that were not believed safe, and marked as such.
        missing: trials of the budget that were not made because the method abstained.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    fits: int
    jitters: int
    fallbacks: int
    marked: int
    missing: int


class RunMeta(BaseModel):
    """What a run file says about itself.

    Attributes:
        task: name of the task.
        method: name of the method.
        profile: the sizes it was run with.
        beta: scalar of the confidence bound mu + beta*sigma of the safe set; None without one.
        guaranteed_alpha: safe probability that this beta guarantees per trial, 1 - Phi(beta).
        optimum: best safe objective when it is known.
        thresholds: one per safety function.
        n_initial: trials before the optimiser started.
        batch: trials per round.
        n_trials: all trials of a run, the initial ones included.
        seeds: one per run.
        counts: one per run, in the same order; none where the file does not tell.
        space: whether the method searched the codes of an embedding or the problem's own inputs.
        dimension: number of searched coordinates.
        settings: of the method.
        given: what the task gave, by name, see `problems.knowledge`.
        unused: names of what was given and the method does not use.
    """

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    task: str
    method: str
    profile: str
    beta: float | None = None
    guaranteed_alpha: float | None = None
    optimum: float | None = None
    thresholds: list[float] = []
    n_initial: int
    batch: int
    n_trials: int
    seeds: list[int]
    counts: list[RunCounts] = []
    space: Literal["latent", "original"]
    dimension: int
    settings: dict[str, Any] = {}
    given: dict[str, str] = {}
    unused: list[str] = []


@dataclass(frozen=True)
class RunFile:
    """The runs of one method on one task.

    Attributes:
        meta: what the file says about itself.
        trials: one row per trial, sorted by seed and trial; objective, safety and violation are NaN
            where the evaluation failed.
    """

    meta: RunMeta
    trials: pd.DataFrame

    @property
    def optimised(self) -> pd.DataFrame:
        """Completed trials that the method chose: those that Safety and Violation count."""
        return self.trials[~self.trials["initial"] & (self.trials["status"] == "completed")]


def read_run(path: Path) -> RunFile:
    """Read and check a run file.

    Raises:
        DatasetError: the file is no parquet, lacks its metadata or a column, repeats a trial, or holds
            values that contradict each other; the message names the file and the fault.
    """
    table = read_parquet(path, str(path), DatasetError, _COLUMNS)
    meta = _metadata(path, (table.schema.metadata or {}).get(METADATA_KEY))
    trials = _typed(path, table.to_pandas())
    _check(path, meta, trials)
    return RunFile(meta, trials.sort_values(["seed", "trial"], ignore_index=True))


def read_runs(folder: Path) -> dict[tuple[str, str], RunFile]:
    """Every run file of a folder by (task, method), in the order of their names; none if it is missing."""
    runs = (read_run(path) for path in sorted(folder.glob("*.parquet")))
    return {(run.meta.task, run.meta.method): run for run in runs}


def _metadata(path: Path, raw: bytes | None) -> RunMeta:
    if raw is None:
        raise DatasetError(
            f"{path}: schema metadata {METADATA_KEY.decode()!r} is missing; expected JSON about the run"
        )
    try:
        meta = RunMeta.model_validate(json.loads(raw))
    except ValidationError as error:
        faults = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())
        raise DatasetError(f"{path}: metadata: {faults}") from None
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: metadata is no JSON: {error}") from error
    if path.stem != f"{meta.task}-{meta.method}":
        raise DatasetError(
            f"{path}: holds task {meta.task!r} and method {meta.method!r}; expected the name "
            f"{meta.task}-{meta.method}.parquet"
        )
    return meta


def _typed(path: Path, frame: pd.DataFrame) -> pd.DataFrame:
    """The same table with plain numpy columns."""
    try:
        kinds = (
            dict.fromkeys(_INTEGERS, np.int64)
            | dict.fromkeys(_BOOLEANS, np.bool_)
            | dict.fromkeys(_NUMBERS, np.float64)
        )
        return frame.astype(kinds)
    except (TypeError, ValueError) as error:
        raise DatasetError(f"{path}: a column has the wrong type: {error}") from error


def _check(path: Path, meta: RunMeta, frame: pd.DataFrame) -> None:
    """Raise `DatasetError` for rows that cannot be true."""
    repeated = frame.duplicated(["seed", "trial"])
    unknown = set(frame["status"].unique()) - {"completed", "failed"}
    done = frame[frame["status"] == "completed"]
    probability = frame["predicted_safe_probability"].dropna()
    faults = {
        "no rows": frame.empty,
        "trials that appear twice": bool(repeated.any()),
        f"unknown status {sorted(map(str, unknown))}": bool(unknown),
        "completed trials without finite objective and safety": not np.isfinite(
            done[["objective", "safety", "violation"]].to_numpy()
        ).all(),
        "negative violations": bool((done["violation"] < 0).any()),
        "safe trials with a violation": bool((done["safe"] & (done["violation"] > 0)).any()),
        "safe probabilities outside [0, 1]": bool(((probability < 0) | (probability > 1)).any()),
        "negative times": bool((frame[["method_seconds", "evaluate_seconds"]] < 0).any().any()),
        "initial trials outside round 0": bool((frame["initial"] != (frame["round"] == 0)).any()),
        f"seeds other than those of the metadata {meta.seeds}": set(frame["seed"]) != set(meta.seeds),
    }
    found = [name for name, is_fault in faults.items() if is_fault]
    if found:
        raise DatasetError(f"{path}: {'; '.join(found)}")
