"""The best safe trial of a run file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from report.run_files import trial_table, write_run

from hdsafebo.errors import DatasetError
from hdsafebo.runs.best_trial import best_trial, best_trials

NAN = float("nan")


def write(root: Path, safety: float = 1.0) -> Path:
    """Two seeds of one initial and some chosen trials: the best, at trial 1 of seed 8, is not safe."""
    first = trial_table(7, [9, 5, 6], [1, safety, safety], n_initial=1, batch=1)
    second = trial_table(8, [1, 8, 7, NAN], [1, -1, safety, 1], n_initial=1, batch=1)
    z = [[float(k), -float(k)] for k in range(7)]
    return write_run(root, "toy", "sobol", [first, second], n_initial=1, batch=1, z=z)


def test_best_of_the_safe_chosen_trials(tmp_path: Path) -> None:
    found = best_trial(write(tmp_path))
    assert found is not None
    assert (found.method, found.seed, found.trial) == ("sobol", 8, 2)
    assert (found.objective, found.latent) == (7.0, True)
    np.testing.assert_array_equal(found.z, [5.0, -5.0])
    assert (found.safe_share, found.safe_enough) == (3 / 4, False)
    assert found.mean_best == pytest.approx((9 + 7) / 2), "initial trials count for the best of a run"


def test_best_of_every_seed(tmp_path: Path) -> None:
    path = write(tmp_path)
    assert [(one.seed, one.trial, one.objective) for one in best_trials(path)] == [(7, 2, 6.0), (8, 2, 7.0)]
    initial = best_trials(path, initial=True)
    assert [(one.seed, one.trial, one.objective) for one in initial] == [(7, 0, 9.0), (8, 0, 1.0)]
    np.testing.assert_array_equal([one.z for one in initial], [[0.0, 0.0], [3.0, -3.0]])


def test_none_when_no_chosen_trial_was_safe(tmp_path: Path) -> None:
    assert best_trial(write(tmp_path, safety=-1.0)) is None


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="cannot be read as parquet"):
        best_trial(tmp_path / "none.parquet")
    path = write(tmp_path)
    pq.write_table(pq.read_table(path).drop_columns("z"), path)
    with pytest.raises(DatasetError, match="column z cannot be read"):
        best_trial(path)
