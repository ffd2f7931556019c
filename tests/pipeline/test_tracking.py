"""The MLflow mirror: complete when it works, one notice and no harm when it does not."""

from __future__ import annotations

import http.server
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.pipeline.provenance import digest_paths, git_state, stage_dependencies
from hdsafebo.pipeline.tracking import Tracker, default_uri, flatten, track_stage

PARAMS = {"tasks": {"synthetic": {"budget": {"trials": 30}}}, "methods": {"sobol": {}}}
# What the libraries below MLflow will stop to support is not ours to mend.
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")

DVC_FILE = """
stages:
  optimize:
    matrix: {task: [synthetic], method: [sobol]}
    deps:
      - params-free.txt
      - data/${item.task}.csv
"""


@pytest.fixture(scope="session")
def empty_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with its tables, which take seconds to create."""
    from mlflow.tracking import MlflowClient

    folder = tmp_path_factory.mktemp("store")
    MlflowClient(tracking_uri=default_uri(folder)).search_experiments()
    return folder / "mlruns.db"


@pytest.fixture
def project(tmp_path: Path) -> Path:
    (tmp_path / "dvc.yaml").write_text(DVC_FILE)
    (tmp_path / "params-free.txt").write_text("input")
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "synthetic.csv").write_text("1,2")
    for arguments in (
        ["init", "-q"],
        ["add", "."],
        ["-c", "user.name=a", "-c", "user.email=a@b", "commit", "-qm", "x"],
    ):
        subprocess.run(["git", "-C", str(tmp_path), *arguments], check=True)
    return tmp_path


def write_stage(project: Path) -> None:
    table = project / "table.csv"
    table.write_text("a\n1\n")
    with track_stage("optimize", {}, project) as tracker:
        item = {"task": "synthetic", "method": "sobol"}
        tracker.place("synthetic", "sobol", stage="optimize", item=item, params=PARAMS)
        for seed in (1000, 1001):
            series = {"best_safe_objective": [float("nan"), 1.0, 2.0], "safety_ratio": [1.0, 0.5, 0.5]}
            tracker.log_child(f"seed {seed}", {"seed": seed}, [10, 20, 30], series)
        tracker.log_series([10, 20], {"safety_ratio": [float("nan"), 0.75]})
        tracker.log_metrics({"objective": 2.0, "undefined": float("nan")})
        tracker.log_artifact(table)


@pytest.fixture
def local_store(project: Path, empty_store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    shutil.copy(empty_store, project / "mlruns.db")


@pytest.mark.usefixtures("local_store")
def test_a_stage_is_a_run_with_a_child_per_seed(project: Path) -> None:
    from mlflow.tracking import MlflowClient

    write_stage(project)
    client = MlflowClient(tracking_uri=default_uri(project))
    experiment = client.get_experiment_by_name("synthetic")
    runs = client.search_runs([experiment.experiment_id])
    parents = [run for run in runs if "mlflow.parentRunId" not in run.data.tags]
    children = [run for run in runs if "mlflow.parentRunId" in run.data.tags]
    assert len(parents) == 1
    parent = parents[0]
    state = git_state(project)
    assert state is not None
    assert parent.info.status == "FINISHED"
    assert parent.data.metrics == {"objective": 2.0, "safety_ratio": 0.75}
    assert parent.data.params == {"tasks.synthetic.budget.trials": "30"}
    assert parent.data.tags.items() >= {
        "stage": "optimize", "task": "synthetic", "method": "sobol",
        "git_revision": state[0], "git_dirty": "false",
        "deps_hash": digest_paths([project / "params-free.txt", project / "data/synthetic.csv"], project),
    }.items()  # fmt: skip
    assert [artefact.path for artefact in client.list_artifacts(parent.info.run_id)] == ["table.csv"]
    assert list((project / "mlartifacts").rglob("table.csv"))
    assert {run.info.run_name for run in children} == {"seed 1000", "seed 1001"}
    for run in children:
        assert run.data.tags["mlflow.parentRunId"] == parent.info.run_id
        assert run.info.status == "FINISHED"
        history = client.get_metric_history(run.info.run_id, "best_safe_objective")
        assert [(m.step, m.value) for m in history] == [(20, 1.0), (30, 2.0)]
        assert len(client.get_metric_history(run.info.run_id, "safety_ratio")) == 3


@pytest.mark.usefixtures("local_store")
def test_a_failing_stage_is_a_failed_run(project: Path) -> None:
    from mlflow.tracking import MlflowClient

    with pytest.raises(ZeroDivisionError), track_stage("solve_lead_field", {}, project):
        raise ZeroDivisionError
    client = MlflowClient(tracking_uri=default_uri(project))
    run = client.search_runs([client.get_experiment_by_name("pipeline").experiment_id])[0]
    assert (run.info.status, run.info.run_name) == ("FAILED", "solve_lead_field")


@pytest.mark.usefixtures("local_store")
def test_a_run_that_was_cut_ends_as_killed_when_its_stage_runs_again(project: Path) -> None:
    from mlflow.tracking import MlflowClient

    for stage in ("fit_synergies", "solve_lead_field"):
        cut = Tracker(stage, {}, project)
        cut.log_metrics({"done": 0.5})  # and then the power fails
    with track_stage("solve_lead_field", {}, project):
        pass
    client = MlflowClient(tracking_uri=default_uri(project))
    runs = client.search_runs([client.get_experiment_by_name("pipeline").experiment_id])
    assert sorted((run.info.run_name, run.info.status) for run in runs) == [
        ("fit_synergies", "RUNNING"), ("solve_lead_field", "FINISHED"), ("solve_lead_field", "KILLED"),
    ]  # fmt: skip


@pytest.mark.usefixtures("local_store")
def test_refused_parameters_leave_no_run(project: Path) -> None:
    from mlflow.tracking import MlflowClient

    with pytest.raises(ParamsError), track_stage("optimize", {}, project):
        raise ParamsError("methods: no block 'x'")
    assert MlflowClient(tracking_uri=default_uri(project)).get_experiment_by_name("pipeline") is None


class Broken(http.server.BaseHTTPRequestHandler):
    """Accepts requests and never answers them, or answers with an error."""

    hang = False

    def do_GET(self) -> None:
        if self.hang:
            time.sleep(30)
        self.send_error(500)

    do_POST = do_GET

    def log_message(self, *arguments: object) -> None:
        pass


@pytest.fixture(params=["refuses", "errors", "hangs"])
def broken_server(request: pytest.FixtureRequest) -> Iterator[str]:
    if request.param == "refuses":
        yield "http://user:secret@127.0.0.1:9"
        return
    handler = type("Handler", (Broken,), {"hang": request.param == "hangs"})
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    server.daemon_threads = True
    server.block_on_close = False
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://user:secret@127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    server.server_close()


def test_a_broken_server_costs_one_notice_and_seconds(
    project: Path, broken_server: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", broken_server)
    start = time.monotonic()
    write_stage(project)
    assert time.monotonic() - start < 25
    printed = capsys.readouterr().err
    assert printed.count("NOTICE [optimize]: tracking is off for the rest of this stage") == 1
    assert "secret" not in printed
    assert not (project / "mlruns.db").exists()


@pytest.mark.usefixtures("local_store")
def test_a_store_that_breaks_in_mid_stage_costs_one_notice(
    project: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from mlflow.tracking import MlflowClient

    with track_stage("optimize", PARAMS, project) as tracker:
        tracker.log_metrics({"a": 1.0})
        monkeypatch.setattr(MlflowClient, "log_batch", lambda *a, **k: 1 / 0)
        tracker.log_metrics({"b": 1.0})
        tracker.log_metrics({"c": 1.0})
    printed = capsys.readouterr().err
    assert printed.count("NOTICE") == 1
    assert "ZeroDivisionError" in printed


def test_tracking_that_is_off_imports_and_writes_nothing(project: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from hdsafebo.pipeline.tracking import track_stage\n"
        f"with track_stage('s', {{}}, Path({str(project)!r}), enabled=False) as tracker:\n"
        "    tracker.log_metrics({'a': 1.0})\n"
        "assert not any(name.split('.')[0] == 'mlflow' for name in sys.modules)"
    )
    before = sorted(project.rglob("*"))
    subprocess.run([sys.executable, "-c", code], check=True)
    assert sorted(project.rglob("*")) == before


def test_provenance_follows_contents(project: Path) -> None:
    paths = [project / "data", project / "missing"]
    first = digest_paths(paths, project)
    assert first == digest_paths(list(reversed(paths)), project)
    (project / "data" / "synthetic.csv").write_text("1,3")
    second = digest_paths(paths, project)
    (project / "missing").write_text("")
    assert len({first, second, digest_paths(paths, project)}) == 3
    state = git_state(project)
    assert state is not None
    assert state[1] is True
    subprocess.run(["git", "-C", str(project), "checkout", "-q", "data"], check=True)
    (project / "dvc.lock").write_text("written by the pipeline")
    assert git_state(project) == (state[0], False)
    assert git_state(Path("/")) is None


def test_dependencies_of_a_matrix_item() -> None:
    import yaml

    found = stage_dependencies(yaml.safe_load(DVC_FILE), "optimize", {"task": "hand", "method": "sobol"})
    assert found == ["params-free.txt", "data/hand.csv"]
    assert stage_dependencies({}, "optimize", {}) == []


def test_flatten() -> None:
    assert flatten({"a": {"b": 1, "c": {"d": [2]}}, "e": None}) == {"a.b": 1, "a.c.d": [2], "e": None}
