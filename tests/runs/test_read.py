"""Run files are read exactly, and every malformed one is refused by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest
from report.run_files import NO_FAULTS, trial_table, write_run

from hdsafebo.errors import DatasetError
from hdsafebo.runs.read import read_run, read_runs


def one_run() -> pd.DataFrame:
    return trial_table(3, [1.0, 2.0, 3.0, float("nan")], [0.5, -0.5, 0.1, 0.2], n_initial=2, batch=2)


def test_reads_rows_and_metadata(tmp_path: Path) -> None:
    path = write_run(tmp_path, "toy", "sobol", [one_run()], n_initial=2, batch=2, optimum=4.0, beta=2.0)
    run = read_run(path)
    assert (run.meta.task, run.meta.method, run.meta.seeds) == ("toy", "sobol", [3])
    assert (run.meta.optimum, run.meta.beta, run.meta.n_trials) == (4.0, 2.0, 4)
    assert run.trials["objective"].tolist()[:3] == [1.0, 2.0, 3.0]
    assert run.trials["status"].tolist() == ["completed"] * 3 + ["failed"]
    assert run.chosen["trial"].tolist() == [2], "initial and failed trials are not the method's choices"


def test_rows_are_sorted(tmp_path: Path) -> None:
    path = write_run(tmp_path, "toy", "sobol", [one_run().iloc[::-1]], n_initial=2, batch=2)
    assert read_run(path).trials["trial"].tolist() == [0, 1, 2, 3]


def test_no_folder_is_no_runs(tmp_path: Path) -> None:
    assert read_runs(tmp_path / "nowhere") == {}


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda t: t.drop(columns="violation"), r"columns \['violation'\] are missing"),
        (lambda t: pd.concat([t, t.iloc[:1]]), "appear twice"),
        (lambda t: t.assign(status="done"), r"unknown status \['done'\]"),
        (lambda t: t.assign(status="completed"), "without finite objective"),
        (lambda t: t.assign(violation=-t["violation"].abs() - 1), "negative violations"),
        (lambda t: t.assign(safe=True), "safe trials with a violation"),
        (lambda t: t.assign(predicted_safe_probability=1.5), r"outside \[0, 1\]"),
        (lambda t: t.assign(method_seconds=-1.0), "negative or infinite times"),
        (lambda t: t.assign(evaluate_seconds=float("nan")), "negative or infinite times"),
        (lambda t: t.drop(index=0), "trials other than 0, 1, 2"),
        (lambda t: t.drop(index=1), "trials other than 0, 1, 2"),
        (lambda t: t.assign(trial=t["trial"] + 100), "trials other than 0, 1, 2"),
        (lambda t: t.assign(trial=t["trial"] - 1), "trials other than 0, 1, 2"),
        (lambda t: t.assign(initial=True), "initial trials outside round 0"),
        (lambda t: t.assign(objective="much"), "wrong type"),
        (lambda t: t.assign(objective=t["objective"].fillna(9.0)), "failed trials with results"),
        (
            lambda t: t.assign(safe=t["safe"] | (t["status"] == "failed")),
            "failed trials with results, or safe",
        ),
        (lambda t: t.assign(violation_bound=-1.0), "negative sizes"),
        (lambda t: t.assign(round=t["round"] * 7), "rounds other than 0, 1, 2"),
        (lambda t: t.assign(round=-t["round"]), "rounds other than 0, 1, 2"),
        (lambda t: t.assign(candidate=-5), "candidates below -1"),
    ],
)
def test_malformed_rows_are_refused(
    tmp_path: Path, damage: Callable[[pd.DataFrame], pd.DataFrame], message: str
) -> None:
    path = write_run(tmp_path, "toy", "sobol", [damage(one_run())], n_initial=2, batch=2)
    with pytest.raises(DatasetError, match=message) as error:
        read_run(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({"n_trials": 5}, "trials other than the 5 of the metadata less those missing"),
        ({"counts": [NO_FAULTS | {"missing": 1}], "n_trials": 4}, "less those missing"),
        ({"counts": [NO_FAULTS | {"missing": 1}]}, "trials missing of runs that did not abstain"),
        ({"counts": [NO_FAULTS | {"jitters": -1}]}, "negative counts"),
        ({"n_initial": 1}, "initial trials other than the 1 of the metadata"),
        ({"counts": [NO_FAULTS | {"marked": 3}]}, "marked trials other than those of the counts"),
        ({"batch": 1}, "rounds of more than 1 trials"),
        ({"thresholds": [0.0, 1.0]}, r"thresholds \[0.0, 1.0\], expected one for each of"),
        ({"thresholds": [0.3]}, r"safe trials other than those at or above the threshold \[0.3\]"),
        ({"beta": 2.0, "guaranteed_alpha": 0.9}, r"guaranteed_alpha 0.9, expected 1 - Phi\(beta\)"),
        ({"beta": None, "guaranteed_alpha": 0.1}, r"guaranteed_alpha 0.1, expected 1 - Phi\(beta\)"),
    ],
)
def test_rows_must_be_those_of_which_the_metadata_speaks(
    tmp_path: Path, metadata: dict[str, object], message: str
) -> None:
    path = write_run(tmp_path, "toy", "sobol", [one_run()], **({"n_initial": 2, "batch": 2} | metadata))
    with pytest.raises(DatasetError, match=message):
        read_run(path)


def test_a_rounded_safety_may_lie_at_the_other_side_of_the_threshold(tmp_path: Path) -> None:
    table = one_run().assign(
        safety=[-0.7501, -1.0, 0.1, float("nan")], violation=[0.0, 0.25, 0.0, float("nan")]
    )
    path = write_run(tmp_path, "toy", "sobol", [table], n_initial=2, batch=2, thresholds=[-0.75])
    assert read_run(path).trials["safe"].tolist() == [True, False, True, False]


def test_seeds_must_be_those_of_the_metadata(tmp_path: Path) -> None:
    path = write_run(tmp_path, "toy", "sobol", [one_run()], n_initial=2, batch=2, seeds=[3, 4])
    with pytest.raises(DatasetError, match="seeds other than"):
        read_run(path)


def test_seeds_must_differ(tmp_path: Path) -> None:
    twice = {"seeds": [3, 3], "counts": [NO_FAULTS] * 2}
    path = write_run(tmp_path, "toy", "sobol", [one_run()], n_initial=2, batch=2, **twice)
    with pytest.raises(DatasetError, match="some twice"):
        read_run(path)


def test_malformed_metadata_is_refused(tmp_path: Path) -> None:
    path = write_run(tmp_path, "toy", "sobol", [one_run()], n_initial=2, batch=2, space="nowhere")
    with pytest.raises(DatasetError, match="metadata: space"):
        read_run(path)
    table = pq.read_table(path)
    pq.write_table(table.replace_schema_metadata({}), path)
    with pytest.raises(DatasetError, match="'hdsafebo' is missing"):
        read_run(path)
    pq.write_table(table.replace_schema_metadata({b"hdsafebo": b"{"}), path)
    with pytest.raises(DatasetError, match="no JSON"):
        read_run(path)


def test_name_must_fit_the_content(tmp_path: Path) -> None:
    path = write_run(tmp_path, "toy", "sobol", [one_run()], n_initial=2, batch=2)
    with pytest.raises(DatasetError, match=r"expected the name toy-sobol\.parquet"):
        read_run(path.rename(path.with_name("toy-cei.parquet")))


def test_what_is_no_parquet_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "toy-sobol.parquet"
    path.write_bytes(b"PAR1 nonsense")
    with pytest.raises(DatasetError, match="cannot be read as parquet"):
        read_run(path)
