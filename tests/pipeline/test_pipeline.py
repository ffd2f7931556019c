"""The whole pipeline at the size of the smoke profile, in a copy of the project."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import read_mapping, write_mapping

pytestmark = pytest.mark.timeout(3600)  # the first test waits for the whole run

COPIED = (
    "src",
    "stages",
    "profiles",
    "data/mnist",
    "reports/reference/benchmarks/outside/table.json",
    "dvc.yaml",
    "params.yaml",
    ".dvc/config",
    ".dvc/plots",
    ".dvcignore",
    "pyproject.toml",
)
SOBOL_RUNS = {
    "optimize_synthetic@sobol",
    "optimize_hand@hand-sobol",
    "optimize_hand@hand_informed-sobol",
    "optimize_scs@scs_st-sobol",
    "optimize_scs@scs_st_informed-sobol",
    "optimize_digits@digits_3-sobol",
    "optimize_digits@digits_3_informed-sobol",
}
"""The runs of one method in the smoke profile."""


def run(root: Path, *command: str, ok: bool = True) -> str:
    """Run a command of the environment in `root`; returns what it printed."""
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(root / "src"),
        "DVC_NO_ANALYTICS": "1",
    }
    environment.pop("OMP_NUM_THREADS", None)
    result = subprocess.run(
        command,
        cwd=root,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    if ok and result.returncode:
        pytest.fail(f"{' '.join(command)} ended with {result.returncode}\n{result.stdout}\n{result.stderr}")
    return result.stdout + result.stderr


def changed_stages(root: Path) -> set[str]:
    """Stages that `dvc repro` would run now because of their own deps and params."""
    return set(json.loads(run(root, "dvc", "status", "--json").splitlines()[-1]))


@pytest.fixture(scope="module")
def finished(project_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project in which `dvc repro` has run the smoke profile."""
    root = tmp_path_factory.mktemp("project")
    for name in COPIED:
        source, target = project_root / name, root / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
        else:
            shutil.copy2(source, target)
    run(root, "git", "init", "--quiet")
    run(root, "hdsafebo", "profile", "smoke", "--force")
    run(root, "dvc", "repro")
    return root


def test_every_output_is_there(finished: Path) -> None:
    for stage in read_mapping(finished / "dvc.lock", ParamsError)["stages"].values():
        for out in stage["outs"]:
            assert (finished / out["path"]).exists()
    summary = json.loads((finished / "reports" / "summary.json").read_text())
    assert summary["profile"] == "smoke"
    assert summary["traversal"]["rows"] == 218_000
    assert {"synthetic", "hand", "body", "scs_st"} <= set(summary)
    page = (finished / "reports" / "index.html").read_text()
    assert page.rstrip().endswith("</html>")
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_run_files_hold_what_the_params_ask_for(finished: Path) -> None:
    params = read_mapping(finished / "params.yaml", ParamsError)
    budget = params["tasks"]["synthetic"]["budget"]
    for method in params["tasks"]["synthetic"]["methods"]:
        table = pq.read_table(finished / "data" / "runs" / f"synthetic-{method}.parquet").to_pandas()
        assert len(table) == budget["trials"] * budget["seeds"]
        assert table.groupby("seed")["initial"].sum().eq(budget["initial"]).all()


def test_the_mlflow_store_has_an_experiment_per_task(finished: Path) -> None:
    from mlflow.tracking import MlflowClient

    client = MlflowClient(f"sqlite:///{finished / 'mlruns.db'}")
    names = {experiment.name for experiment in client.search_experiments()}
    assert {"synthetic", "hand", "body", "scs_st"} <= names


def test_a_second_repro_runs_nothing(finished: Path) -> None:
    start = time.perf_counter()
    output = run(finished, "dvc", "repro")
    print(f"no-op repro: {time.perf_counter() - start:.1f} s")
    assert "Running stage" not in output
    assert "up to date" in output


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("tasks.hand.budget.batch", 4, {"optimize_hand@", "report"}),
        ("tasks.synthetic.problem.threshold", -0.5, {"optimize_synthetic@", "report"}),
        (
            "tasks.body.problem.most_load",
            200.0,
            {"record_body", "optimize_body@", "replay_body", "report"},
        ),
        ("tasks.body.budget.batch", 2, {"optimize_body@", "replay_body", "report"}),
        ("isometry.points", 1000, {"check_isometry", "report"}),
        ("report.confidence", 0.9, {"report"}),
        (
            "methods.sobol",
            {"unused": 1},
            {
                "code",
                *SOBOL_RUNS,
            },
        ),
        ("tracking.enabled", False, set()),
        ("compute.workers", 1, set()),
    ],
)
def test_a_change_of_one_block_reruns_exactly_its_dependants(
    finished: Path, key: str, value: object, expected: set[str]
) -> None:
    path = finished / "params.yaml"
    before = path.read_text()
    data = read_mapping(path, ParamsError)
    block = data
    *parents, last = key.split(".")
    for name in parents:
        block = block[name]
    block[last] = value
    try:
        write_mapping(path, data, ParamsError)
        changed = changed_stages(finished)
    finally:
        path.write_text(before)
    assert all(any(stage.startswith(prefix) for prefix in expected) for stage in changed), changed
    assert all(any(stage.startswith(prefix) for stage in changed) for prefix in expected), changed


@pytest.mark.parametrize(
    ("module", "expected"),
    [
        ("optimizers/baselines/safeopt.py", set()),  # the smoke profile does not run it
        (
            "optimizers/controls/sobol.py",
            SOBOL_RUNS,
        ),
        ("spinal/finite_elements/solver.py", {"solve_lead_field"}),
        ("report/page.py", {"report"}),
    ],
)
def test_a_change_of_a_module_reruns_its_users_only(finished: Path, module: str, expected: set[str]) -> None:
    path = finished / "src" / "hdsafebo" / module
    before = path.read_text()
    try:
        path.write_text(before + "\nCHANGED = 1\n")
        run(finished, "dvc", "repro", "--single-item", "code")
        assert changed_stages(finished) == expected
    finally:
        path.write_text(before)
        run(finished, "dvc", "repro", "--single-item", "code")


def test_a_damaged_output_is_noticed(finished: Path) -> None:
    path = finished / "reports" / "isometry.json"
    before = path.read_bytes()
    path.chmod(0o644)
    try:
        path.write_bytes(before + b" ")
        assert changed_stages(finished)
    finally:
        path.write_bytes(before)


def test_metrics_and_plots_are_shown(finished: Path) -> None:
    assert "traversal" in run(finished, "dvc", "metrics", "show", "--json")
    run(finished, "dvc", "plots", "show")
    assert (finished / "dvc_plots" / "index.html").exists()


def test_a_wrong_method_ends_with_exit_code_2(finished: Path) -> None:
    path = finished / "params.yaml"
    before = path.read_text()
    try:
        path.write_text(before.replace("batch: 10", "batch: ten", 1))
        output = run(finished, sys.executable, "stages/optimize.py", "synthetic", "sobol", ok=False)
    finally:
        path.write_text(before)
    assert "batch" in output
    assert "Traceback" not in output
