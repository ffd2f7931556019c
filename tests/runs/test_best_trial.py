"""The best safe trial of a run file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from hdsafebo.errors import DatasetError
from hdsafebo.runs.best_trial import best_trial

ROWS: dict[str, list] = {
    "seed": [7, 7, 7, 8, 8, 8, 8],
    "trial": [0, 1, 2, 0, 1, 2, 3],
    "initial": [True, False, False, True, False, False, False],
    "objective": [9.0, 5.0, 6.0, 1.0, 8.0, 7.0, float("nan")],
    "safe": [True, True, True, True, False, True, False],
    "status": [*["completed"] * 6, "failed"],
    "z": [[float(k), -float(k)] for k in range(7)],
}


def write(path: Path, **changed: list) -> Path:
    metadata = {b"hdsafebo": json.dumps({"method": "sobol", "space": "latent"}).encode()}
    pq.write_table(pa.table(ROWS | changed).replace_schema_metadata(metadata), path)
    return path


def test_best_of_the_safe_proposed_trials(tmp_path: Path) -> None:
    found = best_trial(write(tmp_path / "run.parquet"))
    assert found is not None
    assert (found.method, found.seed, found.trial, found.objective, found.latent) == (
        "sobol",
        8,
        2,
        7.0,
        True,
    )
    np.testing.assert_array_equal(found.z, [5.0, -5.0])
    assert found.mean_best == pytest.approx(
        (9 + 7) / 2
    )  # best safe values of the runs, initial ones included


def test_none_when_nothing_proposed_was_safe(tmp_path: Path) -> None:
    assert best_trial(write(tmp_path / "run.parquet", safe=ROWS["initial"])) is None


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="cannot be read as a run file"):
        best_trial(tmp_path / "none.parquet")
    pq.write_table(pa.table(ROWS), tmp_path / "plain.parquet")
    with pytest.raises(DatasetError, match="cannot be read as a run file"):
        best_trial(tmp_path / "plain.parquet")
