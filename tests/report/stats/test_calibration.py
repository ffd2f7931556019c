"""Calibration and regret on rows whose answers can be counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from hdsafebo.report.stats.calibration import calibrate
from hdsafebo.report.stats.regret import regret
from hdsafebo.runs.read import read_run
from report.run_files import trial_table, write_run

NAN = float("nan")


def test_bins_and_scores(tmp_path: Path) -> None:
    probability = np.array([0.5, 0.1, 0.1, 0.9, 0.9, 0.9, 1.0])
    safety = [1, -1, 1, 1, 1, -1, 1]
    table = trial_table(0, [0.0] * 7, safety, n_initial=1, batch=1, probability=probability)
    run = read_run(write_run(tmp_path, "toy", "scbo", [table], n_initial=1, batch=1))
    c = calibrate([run], bins=2, confidence=0.95)
    assert c is not None
    assert c.trials == 6, "the initial trial has no prediction"
    assert c.bins["trials"].tolist() == [2, 4]
    np.testing.assert_allclose(c.bins["predicted"], [0.1, 3.7 / 4])
    np.testing.assert_allclose(c.bins["observed"], [0.5, 0.75])
    # Clopper and Pearson: the limits at which 1 of 2 and 3 of 4 leave 2.5 % in a tail of the binomial.
    for (low, high), (k, n) in zip(
        c.bins[["observed_low", "observed_high"]].to_numpy(), [(1, 2), (3, 4)], strict=True
    ):
        assert binom.sf(k - 1, n, low) == pytest.approx(0.025)
        assert binom.cdf(k, n, high) == pytest.approx(0.025)
    assert c.observed == pytest.approx(4 / 6)
    assert c.predicted == pytest.approx(3.9 / 6)
    assert c.brier == pytest.approx((0.01 + 0.81 + 0.01 + 0.01 + 0.81 + 0.0) / 6)
    assert c.brier_constant == pytest.approx(2 / 9)


def test_true_predictions_lie_within_their_intervals(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    p = rng.uniform(size=5000)
    g = np.where(rng.uniform(size=5000) < p, 1.0, -1.0)
    table = trial_table(0, [0.0] * 5000, g, n_initial=1, batch=1, probability=p)
    run = read_run(write_run(tmp_path, "toy", "scbo", [table], n_initial=1, batch=1))
    c = calibrate([run], bins=10, confidence=0.999)
    assert c is not None
    assert (c.bins["observed_low"] <= c.bins["predicted"]).all()
    assert (c.bins["predicted"] <= c.bins["observed_high"]).all()
    assert c.brier == pytest.approx(1 / 6, abs=0.01), "E[p (1 - p)] for uniform p"


def test_without_predictions_there_is_no_calibration(tmp_path: Path) -> None:
    table = trial_table(0, [0.0, 1.0], [1, 1], n_initial=1, batch=1)
    run = read_run(write_run(tmp_path, "toy", "sobol", [table], n_initial=1, batch=1))
    assert calibrate([run], bins=10, confidence=0.95) is None


def test_regret(tmp_path: Path) -> None:
    n = 600
    rising = np.linspace(0, 4, n)
    flat = np.full(n, 2.0)
    tables = [trial_table(k, f, np.ones(n), n_initial=200, batch=10) for k, f in enumerate((rising, flat))]
    run = read_run(write_run(tmp_path, "scs_st", "scbo", tables, n_initial=200, batch=10, optimum=4.0))
    table = regret(run)
    assert table is not None
    np.testing.assert_allclose(table["share_300"], [299 / 599, 0.5])
    np.testing.assert_allclose(table["share_600"], [1.0, 0.5])
    assert table["share_1000"].isna().all(), "the runs end before"
    assert table["trials_to_95"].iloc[0] == 580, (
        "the first round whose last trial reaches 0.95, after 571 trials"
    )
    assert np.isnan(table["trials_to_95"].iloc[1])


def test_no_regret_without_an_optimum(tmp_path: Path) -> None:
    table = trial_table(0, [0.0, 1.0], [1, 1], n_initial=1, batch=1)
    assert regret(read_run(write_run(tmp_path, "toy", "sobol", [table], n_initial=1, batch=1))) is None
