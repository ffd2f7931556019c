"""Reads run files, and refuses contents that contradict themselves; `schema` says what a run file holds."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from pydantic import ValidationError
from scipy.stats import norm

from hdsafebo.errors import DatasetError
from hdsafebo.files.parquet import read_parquet
from hdsafebo.runs.schema import (
    COLUMNS,
    METADATA_KEY,
    STATUS_NAMES,
    TIMES,
    RunMetadata,
    arrow_type,
    run_name,
)

if TYPE_CHECKING:
    import pyarrow as pa

_ROUNDED = 2.0**-12
"""Relative error of the values of kept evidence, in which what was safe stays as it was decided."""


@dataclass(frozen=True)
class RunFile:
    """The runs of one method on one task.

    Attributes:
        meta: what the file says about itself.
        trials: one row per trial, sorted by seed and trial; objective, safety and violation are NaN
            where the evaluation failed.
    """

    meta: RunMetadata
    trials: pd.DataFrame

    @property
    def chosen(self) -> pd.DataFrame:
        """Completed trials that the method chose; Safety and Violation count these trials only."""
        return self.trials[~self.trials["initial"] & (self.trials["status"] == "completed")]


def read_run(path: Path) -> RunFile:
    """Read and check a run file.

    Raises:
        DatasetError: the file is no parquet, lacks its metadata or a column, repeats a trial, or holds
            values that contradict each other; the message names the file and the fault.
    """
    table = read_parquet(path, str(path), DatasetError, list(COLUMNS))
    meta = _metadata(path, (table.schema.metadata or {}).get(METADATA_KEY))
    trials = _typed(path, table).to_pandas()
    _check(path, meta, trials)
    return RunFile(meta, trials.sort_values(["seed", "trial"], ignore_index=True))


def read_runs(folder: Path) -> dict[tuple[str, str], RunFile]:
    """Every run file of a folder by (task, method), in the order of names; empty for a missing folder."""
    runs = (read_run(path) for path in sorted(folder.glob("*.parquet")))
    return {(run.meta.task, run.meta.method): run for run in runs}


def _metadata(path: Path, raw: bytes | None) -> RunMetadata:
    if raw is None:
        raise DatasetError(
            f"{path}: schema metadata {METADATA_KEY.decode()!r} is missing; expected JSON about the run"
        )
    try:
        meta = RunMetadata.model_validate(json.loads(raw))
    except ValidationError as error:
        faults = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())
        raise DatasetError(f"{path}: metadata: {faults}") from None
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: metadata is no JSON: {error}") from error
    expected = run_name(meta.task, meta.method)
    if path.stem != expected:
        raise DatasetError(
            f"{path}: holds task {meta.task!r} and method {meta.method!r}; expected the name "
            f"{expected}.parquet"
        )
    return meta


def _typed(path: Path, table: pa.Table) -> pa.Table:
    """The same table with the types of the schema."""
    import pyarrow as pa

    schema = pa.schema([(name, arrow_type(name)) for name in table.column_names])
    try:
        table = table.cast(schema)
    except pa.ArrowException as error:
        reason = " ".join(str(error).split())[:300]
        raise DatasetError(f"{path}: a column has the wrong type: {reason}") from error
    for name in table.column_names:
        if COLUMNS[name] != "float64" and table[name].null_count:
            raise DatasetError(f"{path}: column {name} has the wrong type: values are missing")
    return table


def _check(path: Path, meta: RunMetadata, frame: pd.DataFrame) -> None:
    """Raise `DatasetError` for rows that cannot be true."""
    repeated = frame.duplicated(["seed", "trial"])
    unknown = set(frame["status"].unique()) - set(STATUS_NAMES.values())
    done = frame[frame["status"] == "completed"]
    probability = frame["predicted_safe_probability"].dropna()
    times = frame[list(TIMES)].to_numpy()
    failed = frame[frame["status"] == "failed"]
    never_negative = frame[["modelled_violation", "violation_bound", "trust_region_length"]].to_numpy()
    faults = {
        "no rows": frame.empty,
        "trials that appear twice": bool(repeated.any()),
        f"unknown status {sorted(map(str, unknown))}": bool(unknown),
        "completed trials without finite objective and safety": not np.isfinite(
            done[["objective", "safety", "violation"]].to_numpy()
        ).all(),
        "negative violations": bool((done["violation"] < 0).any()),
        "failed trials with results, or safe": bool(
            failed[["objective", "safety", "violation"]].notna().any(axis=None) or failed["safe"].any()
        ),
        "negative sizes": bool((never_negative < 0).any()),
        "rounds other than 0, 1, 2, ... of a seed": not _numbered(frame, "round"),
        "candidates below -1": bool((frame["candidate"] < -1).any()),
        "safe trials with a violation": bool((done["safe"] & (done["violation"] > 0)).any()),
        "safe probabilities outside [0, 1]": bool(((probability < 0) | (probability > 1)).any()),
        "negative or infinite times": not np.isfinite(times).all() or bool((times < 0).any()),
        "trials other than 0, 1, 2, ... of a seed": not _numbered(frame),
        "initial trials outside round 0": bool((frame["initial"] != (frame["round"] == 0)).any()),
        f"seeds {meta.seeds}, some twice": len(set(meta.seeds)) < len(meta.seeds),
        f"counts of {len(meta.counts)} runs, expected one per seed": len(meta.counts) != len(meta.seeds),
        "negative counts": any(
            value < 0
            for c in meta.counts
            for value in c.model_dump(exclude={"abstained"}, exclude_none=True).values()
        ),
        "trials missing of runs that did not abstain": any(
            c.missing > 0 and c.abstained is None for c in meta.counts
        ),
        f"seeds other than those of the metadata {meta.seeds}": set(frame["seed"]) != set(meta.seeds),
    }
    faults |= _against_metadata(meta, frame)
    found = [name for name, is_fault in faults.items() if is_fault]
    if found:
        raise DatasetError(f"{path}: {'; '.join(found)}")


def _against_metadata(meta: RunMetadata, frame: pd.DataFrame) -> dict[str, bool]:
    """Faults, by their words, of rows that are not those of which the metadata speaks."""
    by_seed = dict(iter(frame.groupby("seed")))
    runs = [(by_seed[s], c) for s, c in zip(meta.seeds, meta.counts, strict=False) if s in by_seed]
    rounds = frame[~frame["initial"]].groupby(["seed", "round"]).size()
    done = frame[frame["status"] == "completed"]
    return {
        f"trials other than the {meta.n_trials} of the metadata less those missing": any(
            len(rows) + counts.missing != meta.n_trials for rows, counts in runs
        ),
        f"initial trials other than the {meta.n_initial} of the metadata": any(
            int(rows["initial"].sum()) != meta.n_initial for rows, _ in runs
        ),
        "marked trials other than those of the counts": any(
            int(rows["marked_unsafe"].sum()) != counts.marked for rows, counts in runs
        ),
        f"rounds of more than {meta.batch} trials": bool((rounds > meta.batch).any()),
        f"thresholds {meta.thresholds}, expected one for each of {meta.safety_names}": len(meta.thresholds)
        != len(meta.safety_names),
        f"safe trials other than those at or above the threshold {meta.thresholds}": len(meta.thresholds) == 1
        and _contradicted(done, meta.thresholds[0]),
        f"guaranteed_alpha {meta.guaranteed_alpha}, expected 1 - Phi(beta)": meta.guaranteed_alpha is not None
        and (meta.beta is None or not math.isclose(meta.guaranteed_alpha, norm.sf(meta.beta), abs_tol=1e-9)),
    }


def _contradicted(done: pd.DataFrame, threshold: float) -> bool:
    """Whether a trial was called safe below the threshold, or unsafe above it, by more than rounding."""
    beyond = (done["safety"] - threshold).abs() > _ROUNDED * abs(threshold)
    return bool((beyond & (done["safe"] != (done["safety"] >= threshold))).any())


def _numbered(frame: pd.DataFrame, column: str = "trial") -> bool:
    """Whether the trials (or rounds) of each seed are numbered from 0 without a gap."""
    sizes = frame.groupby("seed")[column].agg(["min", "max", "nunique"])
    return bool(((sizes["min"] == 0) & (sizes["max"] + 1 == sizes["nunique"])).all())
