"""Writes run files; see `schema` for what they hold.

The same parameters give the same bytes, but for the two columns of times: revision, host and date are
left to the tracking server.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import DatasetError
from hdsafebo.files.atomic import replacing
from hdsafebo.problem import Problem
from hdsafebo.runs.schema import (
    METADATA_KEY,
    STATUS_NAMES,
    Rows,
    RunMetadata,
    arrow_type,
    safety_columns,
)
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import FloatArray

if TYPE_CHECKING:
    import pyarrow as pa


def rows_of(
    trials: Trials, problem: Problem, *, seed: int, method_seconds: float, evaluate_seconds: float
) -> Rows:
    """Rows of a run file for one round of finished trials.

    Args:
        trials: the round, no trial of it pending.
        problem: says what is safe.
        seed: seed of the run.
        method_seconds: CPU time that the method took for this round.
        evaluate_seconds: CPU time that the evaluation of this round took.
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
        "modelled_violation": modelled_violation(problem, trials.safety),
        "predicted_safe_probability": trials.predicted_safe_probability,
        "violation_bound": trials.violation_bound,
        "trust_region_length": trials.trust_region_length,
        "method_seconds": np.full(n, method_seconds),
        "evaluate_seconds": np.full(n, evaluate_seconds),
        "status": np.array([STATUS_NAMES[Status(s)] for s in trials.status]),
        "marked_unsafe": trials.marked_unsafe,
        "candidate": trials.candidate.astype(np.int64),
        "z": trials.z.astype(np.float32),
    }


def modelled_violation(problem: Problem, safety: FloatArray) -> FloatArray:
    """(n,) sum over modelled safety functions of max(0, h - g), both as they are modelled."""
    modelled = [(j, s) for j, s in enumerate(problem.safety) if s.modelled]
    total = np.zeros(len(safety))
    for j, function in modelled:
        values, threshold = safety[:, j], np.array([function.threshold])
        if function.transform is not None:
            values, threshold = function.transform(values), function.transform(threshold)
        total += np.maximum(0.0, threshold - values)
    return total


def repeats(z: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(k,) True for rows of (k, d) points that equal an earlier one."""
    _, first = np.unique(z, axis=0, return_index=True)
    again = np.ones(len(z), bool)
    again[first] = False
    return again


def join_rows(parts: Sequence[Rows]) -> Rows:
    """Rows of several rounds as one table."""
    return {name: np.concatenate([rows[name] for rows in parts]) for name in parts[0]}


def write_run_file(path: Path, runs: Sequence[Rows], metadata: RunMetadata) -> None:
    """Write a run file, whole or not at all.

    Args:
        path: the file.
        runs: the rows of each seed, in the order of `metadata.seeds`.
        metadata: what the file says about itself.

    Raises:
        DatasetError: the disk cannot be written.
    """
    import pyarrow.parquet as pq

    table = _table(runs, metadata)
    with replacing(path, DatasetError, advice="the runs are kept") as temporary:
        pq.write_table(table, temporary, compression="zstd")


def _table(runs: Sequence[Rows], metadata: RunMetadata) -> pa.Table:
    import pyarrow as pa

    columns: dict[str, pa.Array] = {}
    rows = join_rows([run | {"repeated": repeats(run["z"])} for run in runs])
    for name, joined in rows.items():
        if name == "z":
            offsets = np.arange(0, joined.size + 1, joined.shape[1], dtype=np.int32)
            columns[name] = pa.ListArray.from_arrays(offsets, joined.ravel(), type=arrow_type(name))
        else:
            columns[name] = pa.array(joined, arrow_type(name))
    text = json.dumps(metadata.model_dump(mode="json"), sort_keys=True, allow_nan=False)
    return pa.table(columns).replace_schema_metadata({METADATA_KEY: text.encode()})
