"""A matrix item: the same file from any number of workers, after any kill, in the shape it was promised."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import campaign_toys as toys
import numpy as np
import pyarrow.parquet as pq
import pytest
from campaign_items import (
    Content,
    assert_same_file,
    compute,
    environment,
    journalled,
    wait_for,
    without_times,
)

from hdsafebo.campaign.errors import CampaignError
from hdsafebo.campaign.item import run_path
from hdsafebo.campaign.run_spec import RunSpec
from hdsafebo.campaign.runner import RunResult
from hdsafebo.errors import DatasetError, JournalError, ParamsError
from hdsafebo.runs.read import read_run
from hdsafebo.runs.schema import TIMES, Rows, RunMetadata
from hdsafebo.runs.write import write_run_file


@pytest.fixture(autouse=True)
def _toys_in_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hdsafebo.campaign.item.run", toys.run_toy)


@pytest.fixture
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run in this process: starting workers takes seconds."""

    def execute(function: Any, items: Any, on_result: Any, watcher: Any, **options: Any) -> None:
        for item in items:
            on_result(item, function(item))

    monkeypatch.setattr("hdsafebo.campaign.item.execute", execute)


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> Content:
    """The file of an undisturbed campaign on one worker."""
    root = tmp_path_factory.mktemp("undisturbed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hdsafebo.campaign.item.run", toys.run_toy)
        compute(root, where={"workers": 1})
    return without_times(root)


def test_the_file_does_not_depend_on_the_number_of_workers(tmp_path: Path, expected: Content) -> None:
    recorder = compute(tmp_path, where={"workers": 3})
    assert_same_file(without_times(tmp_path), expected)
    assert sorted(name for name, *_ in recorder.children) == ["toy 1000", "toy 1001", "toy 1002"]


@pytest.mark.usefixtures("_here")
def test_curves_of_the_rounds_are_mirrored(tmp_path: Path) -> None:
    recorder = compute(tmp_path)
    for _, steps, series in recorder.children:
        assert steps == [*range(10, 59, 3), 60]
        assert {len(values) for values in series.values()} == {18}
        best = np.array(series["best_safe_objective"])
        assert np.nanmin(np.diff(best)) >= 0
        assert np.isnan(series["safety_ratio"][0])
    rows = toys.run_toy(toys.toy_spec(tmp_path, seed=1000, trials=60, seeds=3)).rows
    _, _, series = next(child for child in recorder.children if child[0] == "toy 1000")
    chosen = (rows["status"] == "completed") & ~rows["initial"]
    assert series["safety_ratio"][-1] == pytest.approx(rows["safe"][chosen].mean(), rel=1e-12)
    assert series["cumulative_violation"][-1] == pytest.approx(rows["violation"][chosen].sum(), rel=1e-12)
    assert series["best_safe_objective"][-1] == rows["objective"][rows["safe"]].max()
    assert recorder.means[0] == recorder.children[0][1]
    for name, values in recorder.means[1].items():
        curves = [series[name] for _, _, series in recorder.children]
        np.testing.assert_allclose(values, np.mean(curves, axis=0), rtol=1e-12)


@pytest.mark.usefixtures("_here")
def test_the_file_is_what_the_report_reads(tmp_path: Path) -> None:
    compute(tmp_path, seeds=2)
    path = run_path("synthetic", "toy", tmp_path)
    schema = pq.read_schema(path)
    assert {name: str(schema.field(name).type) for name in schema.names} == {
        "seed": "int32", "trial": "int32", "round": "int32", "initial": "bool", "objective": "double",
        "safety_hidden": "double", "safety": "double", "safety_second": "double", "safe": "bool",
        "violation": "double", "modelled_violation": "double", "repeated": "bool",
        "predicted_safe_probability": "double", "violation_bound": "double",
        "trust_region_length": "double", "method_seconds": "double", "evaluate_seconds": "double",
        "status": "string", "marked_unsafe": "bool", "candidate": "int64", "z": "list<element: float>",
    }  # fmt: skip
    run = read_run(path)
    meta = run.meta
    assert (meta.task, meta.method, meta.space, meta.dimension) == ("synthetic", "toy", "latent", 3)
    assert (meta.n_initial, meta.batch, meta.n_trials, meta.seeds) == (10, 3, 60, [1000, 1001])
    assert meta.code == "the code under test"
    assert meta.optimum is None, "it differs between the seeds"
    assert len(run.trials) == 120
    assert (run.trials.groupby(["seed", "round"])[list(TIMES)].nunique() == 1).all(axis=None)


@pytest.mark.usefixtures("_here")
def test_one_algorithm_searches_either_space_under_two_names(tmp_path: Path) -> None:
    compute(tmp_path, seeds=1)
    compute(tmp_path, seeds=1, method="toy_inputs")
    latent, original = (read_run(run_path("synthetic", name, tmp_path)) for name in ("toy", "toy_inputs"))
    assert (latent.meta.algorithm, latent.meta.space, latent.meta.dimension) == ("toy", "latent", 3)
    assert (original.meta.algorithm, original.meta.space, original.meta.dimension) == ("toy", "original", 6)
    assert (latent.meta.method, original.meta.method) == ("toy", "toy_inputs")
    first = [run.trials[run.trials["initial"]]["objective"].to_numpy() for run in (latent, original)]
    np.testing.assert_array_equal(*first, err_msg="the initial trials are those of the task")


@pytest.mark.usefixtures("_here")
def test_equal_runs_are_equal_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def write_without_times(path: Path, runs: list[Rows], metadata: RunMetadata) -> None:
        zero = {name: np.zeros(len(runs[0]["trial"])) for name in TIMES}
        write_run_file(path, [rows | zero for rows in runs], metadata)

    monkeypatch.setattr("hdsafebo.campaign.item.write_run_file", write_without_times)
    for name in "ab":
        compute(tmp_path / name)
    one, two = (run_path("synthetic", "toy", tmp_path / name).read_bytes() for name in "ab")
    assert one == two


def test_a_killed_worker_changes_nothing(
    tmp_path: Path, expected: Content, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "kill-me").touch()
    monkeypatch.setattr("hdsafebo.campaign.item.run", toys.run_toy_and_die_once)
    compute(tmp_path)
    assert not (tmp_path / "kill-me").exists()
    assert "a worker process died" in caplog.text
    assert_same_file(without_times(tmp_path), expected)


CAMPAIGN = """
import signal, sys
from pathlib import Path
import campaign_items, campaign_toys
import hdsafebo.campaign.item as item
item.run = campaign_toys.run_toy
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # who runs tests in the background ignores it
    campaign_items.compute(Path(sys.argv[1]), seconds=0.02, where={"workers": 2})
"""


@pytest.mark.parametrize("kills", [2, pytest.param(15, marks=pytest.mark.slow)])
def test_a_killed_campaign_continues_where_it_was(tmp_path: Path, kills: int) -> None:
    """Kill the process that leads the campaign: its workers end with it, and the next start goes on."""
    trials = 60 if kills < 5 else 400
    script = CAMPAIGN.replace("seconds=", f"trials={trials}, seconds=")
    (tmp_path / "campaign.py").write_text(script)
    root = tmp_path / "killed"
    command = [sys.executable, str(tmp_path / "campaign.py"), str(root)]
    rng = np.random.default_rng(5)
    for _ in range(kills):
        goal = journalled(root) + 3000
        leader = subprocess.Popen(command, env=environment())
        wait_for(lambda goal=goal: journalled(root) > goal, "the campaign made no progress")  # type: ignore[misc]
        time.sleep(rng.uniform(0, 0.1))
        leader.kill()
        leader.wait()
        assert not run_path("synthetic", "toy", root).exists()
    subprocess.run(command, env=environment(), check=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hdsafebo.campaign.item.run", toys.run_toy)
        compute(tmp_path / "undisturbed", trials=trials, seconds=0.02)
    assert_same_file(without_times(root), without_times(tmp_path / "undisturbed"))


def test_an_interrupted_campaign_ends_after_its_rounds_and_continues(tmp_path: Path) -> None:
    """A terminal sends Ctrl-C to every process; the workers leave it to the one that leads them."""
    (tmp_path / "campaign.py").write_text(CAMPAIGN.replace("seconds=", "trials=200, seconds="))
    root = tmp_path / "interrupted"
    command = [sys.executable, str(tmp_path / "campaign.py"), str(root)]
    leader = subprocess.Popen(
        command, env=environment(), start_new_session=True, stderr=subprocess.PIPE, text=True
    )
    wait_for(lambda: journalled(root) > 3000, "the campaign made no progress")
    os.killpg(leader.pid, signal.SIGINT)
    _, said = leader.communicate(timeout=60)
    assert leader.returncode != 0
    assert said.count("KeyboardInterrupt") == 1, f"only the leader is interrupted: {said}"
    subprocess.run(command, env=environment(), check=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hdsafebo.campaign.item.run", toys.run_toy)
        compute(tmp_path / "undisturbed", trials=200, seconds=0.02)
    assert_same_file(without_times(root), without_times(tmp_path / "undisturbed"))


@pytest.mark.usefixtures("_here")
def test_more_seeds_compute_only_what_is_missing(tmp_path: Path) -> None:
    def logs() -> dict[str, bytes]:
        return {path.parent.name: path.read_bytes() for path in tmp_path.glob(".journal/*/rounds.log")}

    compute(tmp_path, seeds=2)
    before = logs()
    compute(tmp_path, seeds=3)
    assert len(logs()) == 3
    assert before.items() <= logs().items()


@pytest.mark.usefixtures("_here")
def test_seeds_of_different_code_are_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def run_changed(spec: RunSpec) -> RunResult:
        return replace(toys.run_toy(spec), code=f"as of seed {spec.seed}")

    monkeypatch.setattr("hdsafebo.campaign.item.run", run_changed)
    with pytest.raises(CampaignError, match="the code was changed while runs were computed"):
        compute(tmp_path, seeds=2)
    assert not run_path("synthetic", "toy", tmp_path).exists()


@pytest.mark.usefixtures("_here")
def test_an_unknown_method_is_named(tmp_path: Path) -> None:
    with pytest.raises(ParamsError, match="methods: no block 'sobol'; it has lonely, toy"):
        compute(tmp_path, method="sobol")


def test_an_error_in_a_run_ends_the_campaign(tmp_path: Path) -> None:
    toys.toy_spec(tmp_path)
    (tmp_path / "data" / "input.txt").unlink()
    (tmp_path / "data" / "input.txt").mkdir()
    with pytest.raises(ParamsError, match=r"input\.txt, which is missing"):
        compute(tmp_path)
    assert not run_path("synthetic", "toy", tmp_path).exists()


@pytest.mark.usefixtures("_here")
def test_places_that_cannot_be_written_are_named(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / ".journal").write_text("in the way")
    with pytest.raises(JournalError, match=r"\.journal: cannot be written"):
        compute(tmp_path / "a")
    (tmp_path / "b" / "data").mkdir(parents=True)
    (tmp_path / "b" / "data" / "runs").write_text("in the way")
    with pytest.raises(DatasetError, match=r"toy\.parquet: cannot be written: .*the runs are kept"):
        compute(tmp_path / "b")
    (tmp_path / "b" / "data" / "runs").unlink()
    compute(tmp_path / "b")
    assert run_path("synthetic", "toy", tmp_path / "b").exists()
