"""Run files: `data/runs/<task>-<method>.parquet`, one row per trial of every seed.

The same parameters give the same bytes, but for the two columns of times: revision, host and date are
left to the tracking server.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import DatasetError
from hdsafebo.problem import Problem
from hdsafebo.trials import Status, Trials

if TYPE_CHECKING:
    import pyarrow

METADATA_KEY = b"hdsafebo"
TIMES = ("method_seconds", "evaluate_seconds")
_TYPES = {
    "seed": "int32",
    "trial": "int32",
    "round": "int32",
    "initial": "bool",
    "objective": "float64",
    "safety": "float64",
    "safe": "bool",
    "violation": "float64",
    "predicted_safe_probability": "float64",
    "violation_bound": "float64",
    "trust_region_length": "float64",
    "method_seconds": "float64",
    "evaluate_seconds": "float64",
    "status": "str",
    "marked_unsafe": "bool",
    "candidate": "int64",
}
_STATUS_NAMES = {Status.COMPLETED: "completed", Status.FAILED: "failed"}

Rows = dict[str, NDArray]
"""Columns of a run file (k,) and `z` (k, d) float32."""


@dataclass(frozen=True)
class RunCounts:
    """What went wrong in the run of one seed without ending it, and what ended it early.

    Attributes:
        fits: Gaussian processes that rounds were asked with, those of all functions counted.
        jitters: fits that needed a larger diagonal than the noise.
        fallbacks: fits that failed, so that the last good hyper-parameters were kept.
        marked: trials that were not believed safe, and marked as such.
        missing: trials of the budget that were not made because the method abstained.
        abstained: why the method ended before the trials were used up; None if it did not.
    """

    fits: int
    jitters: int
    fallbacks: int
    marked: int
    missing: int
    abstained: str | None


@dataclass(frozen=True)
class RunMetadata:
    """What a run file says about itself.

    Attributes:
        task: name of the task.
        method: name of the method.
        profile: name of the sizes it was run with.
        settings: the method's settings.
        safety_names: safety functions in the order of the problem.
        thresholds: one per safety function.
        beta: scalar of the confidence bound of the safe set; None without one.
        guaranteed_alpha: safe probability per trial that this beta guarantees; None without one.
        optimum: best safe objective when it is known and the same for all seeds.
        n_initial: trials before the optimiser starts.
        batch: trials per round.
        n_trials: all trials of a run, the initial ones included.
        seeds: one per run.
        counts: one per run, in the same order.
        space: what is searched, 'latent' or 'original'.
        dimension: number of searched coordinates.
        given: what the task gave, by name, see `problems.knowledge`.
        unused: names of what was given and this method does not use.
    """

    task: str
    method: str
    profile: str
    settings: Mapping[str, object]
    safety_names: list[str]
    thresholds: list[float]
    beta: float | None
    guaranteed_alpha: float | None
    optimum: float | None
    n_initial: int
    batch: int
    n_trials: int
    seeds: list[int]
    counts: list[RunCounts]
    space: str
    dimension: int
    given: Mapping[str, str]
    unused: list[str]


def safety_columns(problem: Problem) -> list[str]:
    """Column names of the problem's safety functions: `safety` for the first that is reported."""
    first = next(j for j, s in enumerate(problem.safety) if s.reported)
    return ["safety" if j == first else f"safety_{s.name}" for j, s in enumerate(problem.safety)]


def rows_of(
    trials: Trials, problem: Problem, *, seed: int, method_seconds: float, evaluate_seconds: float
) -> Rows:
    """Rows of a run file for one round of finished trials.

    Args:
        trials: the round, no trial of it pending.
        problem: says what is safe.
        seed: seed of the run.
        method_seconds: time the method took for this round.
        evaluate_seconds: time the evaluation of this round took.
    """
    n = len(trials)
    safety = dict(zip(safety_columns(problem), trials.safety.T, strict=True))
    return {
        "seed": np.full(n, seed, np.int32),
        "trial": trials.id.astype(np.int32),
        "round": trials.round.astype(np.int32),
        "initial": trials.initial,
        "objective": trials.objective,
        **safety,
        "safe": problem.is_safe(trials.safety),
        "violation": problem.violation(trials.safety),
        "predicted_safe_probability": trials.predicted_safe_probability,
        "violation_bound": trials.violation_bound,
        "trust_region_length": trials.trust_region_length,
        "method_seconds": np.full(n, method_seconds),
        "evaluate_seconds": np.full(n, evaluate_seconds),
        "status": np.array([_STATUS_NAMES[Status(s)] for s in trials.status]),
        "marked_unsafe": trials.marked_unsafe,
        "candidate": trials.candidate.astype(np.int64),
        "z": trials.z.astype(np.float32),
    }


def join_rows(parts: Sequence[Rows]) -> Rows:
    """Rows of several rounds as one table."""
    return {name: np.concatenate([rows[name] for rows in parts]) for name in parts[0]}


def write_run_file(path: Path, runs: Sequence[Rows], metadata: RunMetadata) -> None:
    """Write a run file; it appears whole or not at all.

    Args:
        path: the file.
        runs: the rows of each seed, in the order of `metadata.seeds`.
        metadata: what the file says about itself.

    Raises:
        DatasetError: the disk cannot be written.
    """
    import pyarrow.parquet as pq

    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("wb") as file:
            pq.write_table(_table(runs, metadata), file, compression="zstd")
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink()
        raise DatasetError(
            f"{path}: cannot be written: {error.strerror or error}; the runs are kept"
        ) from error


def _table(runs: Sequence[Rows], metadata: RunMetadata) -> pyarrow.Table:
    import pyarrow as pa

    names = ("str", pa.string()), ("bool", pa.bool_()), ("int32", pa.int32()), ("int64", pa.int64())
    arrow_types = dict(names) | {"float64": pa.float64()}
    columns: dict[str, pa.Array] = {}
    for name, joined in join_rows(runs).items():
        if name == "z":
            offsets = np.arange(0, joined.size + 1, joined.shape[1], dtype=np.int32)
            columns[name] = pa.ListArray.from_arrays(offsets, pa.array(joined.ravel(), pa.float32()))
        else:
            columns[name] = pa.array(joined, arrow_types[_TYPES.get(name, "float64")])
    text = json.dumps(asdict(metadata), sort_keys=True, allow_nan=False)
    return pa.table(columns).replace_schema_metadata({METADATA_KEY: text.encode()})
