"""Curves per round and final metrics, number by number."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from report.run_files import trial_table, write_run

from hdsafebo.report.data.metrics import early_violation, per_seed
from hdsafebo.runs.read import RunFile, read_run
from hdsafebo.runs.series import per_round, pool

NAN = float("nan")


@pytest.fixture
def run(tmp_path: Path) -> RunFile:
    """Seed 0: three rounds of two, one failed. Seed 1: ended after one round, never safe before it."""
    first = trial_table(
        0,
        [1, 5, 2, 9, 3, NAN, 4, 0],
        [1, -1, 1, -2, 1, 1, 1, -0.5],
        n_initial=2,
        batch=2,
        seconds=0.5,
        bound=0.1,
    )
    second = trial_table(1, [7, 8, 1, 3], [-1, -1, 1, 1], n_initial=2, batch=2, seconds=1.5, bound=0.2)
    return read_run(write_run(tmp_path, "toy", "cei", [first, second], n_initial=2, batch=2))


def test_curves(run: RunFile) -> None:
    curves = per_round(run.trials)
    assert curves.units == ("0", "1")
    np.testing.assert_array_equal(curves.objective, [[1, 2, 3, 4], [NAN, 3, 3, 3]])
    np.testing.assert_allclose(curves.safety, [[NAN, 1 / 2, 2 / 3, 3 / 5], [NAN, 1, 1, 1]])
    np.testing.assert_allclose(curves.violation, [[0, 2, 2, 2.5], [0, 0, 0, 0]])
    np.testing.assert_allclose(curves.trials, [2, 4, 5, 6])
    np.testing.assert_allclose(curves.seconds, [[0, 0.5, 0.5, 0.5], [0, 1.5, NAN, NAN]])
    assert np.isnan(curves.region_length).all()


def test_mean_and_error_over_known_values(run: RunFile) -> None:
    mean, error = per_round(run.trials).mean_and_error("objective")
    np.testing.assert_allclose(mean, [1, 2.5, 3, 3.5])
    np.testing.assert_allclose(error, [NAN, 0.5, 0, 0.5], err_msg="|a - b| / 2 for two values; none for one")
    safety, _ = per_round(run.trials).mean_and_error("safety")
    assert np.isnan(safety[0])


def test_final_metrics(run: RunFile) -> None:
    table = per_seed(run)
    assert table.index.tolist() == ["0", "1"]
    assert table["objective"].tolist() == [4.0, 3.0]
    assert table["initial_objective"].tolist()[0] == 1.0
    assert np.isnan(table["initial_objective"].iloc[1])
    assert table["improvement"].iloc[0] == 3.0
    np.testing.assert_allclose(table["safety"], [3 / 5, 1])
    np.testing.assert_allclose(table["violation"], [2.5, 0])
    np.testing.assert_allclose(table["violation_bound"], [0.5, 0.4], err_msg="one bound per completed trial")
    assert table["seconds_per_round"].tolist() == [0.5, 1.5]
    assert table["chosen"].tolist() == [5, 2]
    assert table["failed"].tolist() == [1, 0]


def test_early_violation_counts_the_first_share_of_the_optimized_trials(run: RunFile) -> None:
    assert early_violation(run, 1 / 3).tolist() == [2.0, 0.0]
    assert early_violation(run, 1.0).tolist() == [2.5, 0.0]


def test_pool_makes_each_part_a_unit(run: RunFile) -> None:
    pooled = pool({"a": per_round(run.trials), "b": per_round(run.trials)})
    assert pooled.units == ("a", "b")
    np.testing.assert_allclose(pooled.objective, [[1, 2.5, 3, 3.5]] * 2)
