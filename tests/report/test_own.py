"""What this project says of its own method can fail, and says against whom."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hdsafebo.report.claims.base import Claim
from hdsafebo.report.claims.own import own_claims
from hdsafebo.report.data.results import Results, Uncertainty
from hdsafebo.runs.read import read_runs
from report.run_files import trial_table, write_run

SEEDS = 8
INITIAL, TRIALS, BATCH = 200, 600, 50


def stimulation(root: Path, method: str, reach: float, unsafe: int) -> None:
    """Runs that reach a share of the optimum of 1 in their first round, and then repeat unsafe trials."""
    tables = []
    for seed in range(SEEDS):
        objective = np.where(np.arange(TRIALS) < INITIAL, 0.1, reach - 0.001 * seed)
        safety = np.ones(TRIALS)
        safety[TRIALS - unsafe - seed * (unsafe > 0) :] = -1.0
        safety[: TRIALS - unsafe - SEEDS] = 1.0
        tables.append(trial_table(seed, objective, safety, n_initial=INITIAL, batch=BATCH))
    write_run(root, "scs_st_informed", method, tables, n_initial=INITIAL, batch=BATCH, optimum=1.0)


def claims(root: Path) -> dict[str, Claim]:
    results = Results(read_runs(root / "data/runs"), Uncertainty(bootstrap_samples=200))
    return {claim.name: claim for claim in own_claims(results)}


def test_ahead_of_every_method(tmp_path: Path) -> None:
    stimulation(tmp_path, "hdsafebo_local", 0.99, 0)
    stimulation(tmp_path, "linebo", 0.8, 0)
    stimulation(tmp_path, "scbo", 0.8, 40)
    verdict = claims(tmp_path)["own_scs_st_informed"].verdicts[""]
    assert verdict.status == "reproduced"
    assert verdict.text == "ahead of 2 of 2 (significantly better in a measure, worse in none)"


def test_a_method_that_has_not_run_leaves_the_claim_in_part(tmp_path: Path) -> None:
    stimulation(tmp_path, "hdsafebo_local", 0.99, 0)
    stimulation(tmp_path, "linebo", 0.8, 0)
    planned = [("scs_st_informed", m) for m in ("hdsafebo_local", "linebo", "scbo", "hdsafebo_beta4")]
    results = Results(read_runs(tmp_path / "data/runs"), Uncertainty(bootstrap_samples=200))
    verdict = own_claims(results, [*planned, ("scs_ga", "cei")])[0].verdicts[""]
    assert verdict.status == "partly"
    assert verdict.text == "ahead of 1 of 1 (significantly better in a measure, worse in none); not run: SCBO"


def test_a_safer_method_breaks_the_claim(tmp_path: Path) -> None:
    stimulation(tmp_path, "hdsafebo_local", 0.99, 40)
    stimulation(tmp_path, "random_lowest", 0.8, 0)
    verdict = claims(tmp_path)["own_scs_st_informed"].verdicts[""]
    assert verdict.status == "not"
    assert "worse than Random, lowest current (violation)" in verdict.text


def test_an_equal_method_leaves_it_in_part(tmp_path: Path) -> None:
    stimulation(tmp_path, "hdsafebo_local", 0.99, 0)
    stimulation(tmp_path, "thompson_rows", 0.99, 0)
    verdict = claims(tmp_path)["own_scs_st_informed"].verdicts[""]
    assert verdict.status == "partly"
    assert "undecided against Thompson sampling, all rows" in verdict.text


@pytest.mark.parametrize(("other", "status"), [(400.0, "reproduced"), (520.0, "not")])
def test_the_highest_return_among_safe_methods(tmp_path: Path, other: float, status: str) -> None:
    for method, value in (("hdsafebo_local", 500.0), ("cmaes", other), ("scbo", 900.0)):
        safety = np.ones(24)
        if method == "scbo":
            safety[4:14] = -1.0  # half of what it chose: not among the safe ones
        tables = [trial_table(s, np.full(24, value + s), safety, n_initial=4, batch=10) for s in range(SEEDS)]
        write_run(tmp_path, "hand", method, tables, n_initial=4, batch=10)
    verdict = claims(tmp_path)["own_hand"].verdicts[""]
    assert verdict.status == status
    assert "SCBO" not in verdict.text


def test_nothing_is_said_of_what_was_not_run(tmp_path: Path) -> None:
    assert claims(tmp_path) == {}
    stimulation(tmp_path, "sobol", 0.5, 0)
    assert claims(tmp_path)["own_scs_st_informed"].verdicts[""].status == "not run"
