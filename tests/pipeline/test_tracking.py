"""The MLflow mirror: complete when it works, one notice and no harm when it does not."""

from __future__ import annotations

import contextlib
import http.server
import os
import shutil
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import parse_mapping
from hdsafebo.pipeline.provenance import digest_paths, git_state, stage_dependencies
from hdsafebo.pipeline.store import MlflowStore, StoreError, default_uri, experiments, home_of
from hdsafebo.pipeline.tracking import flatten, track_stage

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
def test_refused_parameters_leave_no_run(project: Path) -> None:
    from mlflow.tracking import MlflowClient

    with pytest.raises(ParamsError), track_stage("optimize", {}, project):
        raise ParamsError("methods: no block 'x'")
    assert MlflowClient(tracking_uri=default_uri(project)).get_experiment_by_name("pipeline") is None


class Broken(http.server.BaseHTTPRequestHandler):
    """Accepts requests, and answers with an error, never, a byte at a time, or that an hour should pass.

    Servers that want more than a stage's time are in `test_mirror_process`.
    """

    how = "errors"

    def do_GET(self) -> None:
        if self.how == "hangs":
            time.sleep(30)
        if self.how == "sends to wait":
            self.send_response(429)
            self.send_header("Retry-After", "3600")
            self.end_headers()
        elif self.how == "trickles":
            self.send_response(200)
            self.end_headers()
            with contextlib.suppress(OSError):
                for _ in range(100):
                    self.wfile.write(b" ")
                    time.sleep(0.5)
        else:
            with contextlib.suppress(OSError):
                self.send_error(500)

    do_POST = do_GET

    def log_message(self, *arguments: object) -> None:
        pass


@pytest.fixture(params=["refuses", "errors", "hangs", "trickles", "sends to wait"])
def broken_server(request: pytest.FixtureRequest) -> Iterator[str]:
    if request.param == "refuses":
        yield "http://user:secret@127.0.0.1:9"
        return
    handler = type("Handler", (Broken,), {"how": request.param})
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    server.daemon_threads = True
    server.block_on_close = False
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://user:secret@127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    server.server_close()


def test_a_broken_server_costs_one_notice_and_leaves_nothing_behind(
    project: Path, broken_server: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", broken_server)
    monkeypatch.setattr("hdsafebo.pipeline.store._CALL_S", 3.0)
    threads = threading.active_count()
    write_stage(project)
    assert not [c for c in psutil.Process().children() if "mlflow_writer" in " ".join(c.cmdline())]
    assert threading.active_count() <= threads + 2, "no more than those of the server's answers"
    printed = caplog.text
    assert printed.count("NOTICE [optimize]: tracking is off for the rest of this stage") == 1
    assert "secret" not in printed
    assert all(record.getMessage().isprintable() for record in caplog.records)
    assert not (project / "mlruns.db").exists()


def test_a_slow_server_holds_a_stage_for_a_share_of_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:9")
    monkeypatch.setattr("hdsafebo.pipeline.store._PATIENCE_S", 0.5)
    store = MlflowStore(tmp_path)
    done = []

    def answer_slowly(limit_s: float) -> None:
        assert 0 < limit_s <= 30
        time.sleep(0.1)
        done.append(True)

    def stage() -> None:
        for _ in range(100):
            store.call(answer_slowly)

    with pytest.raises(StoreError, match="which is enough"):
        stage()
    assert 1 <= len(done) <= 6


def test_stages_that_start_at_once_share_a_new_store(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from mlflow.tracking import MlflowClient

    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    code = (
        "import sys; from pathlib import Path; from hdsafebo.pipeline.tracking import track_stage\n"
        f"with track_stage(sys.argv[1], {{}}, Path({str(project)!r})) as tracker:\n"
        "    tracker.log_metrics({'a': 1.0})"
    )
    stages = [
        subprocess.Popen([sys.executable, "-c", code, name], stderr=subprocess.PIPE, text=True)
        for name in "abcd"
    ]
    assert not [text for stage in stages if "NOTICE" in (text := stage.communicate()[1])]
    client = MlflowClient(tracking_uri=default_uri(project))
    runs = client.search_runs([client.get_experiment_by_name("pipeline").experiment_id])
    assert sorted((run.info.run_name, run.info.status) for run in runs) == [(n, "FINISHED") for n in "abcd"]
    assert experiments(project)["pipeline"] == runs[0].info.experiment_id


def test_a_stage_in_a_copy_of_the_project_is_tracked_in_the_project(
    project: Path, empty_store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`dvc exp run --temp` removes the copy afterwards."""
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    shutil.copy(empty_store, project / "mlruns.db")
    copy = project / ".dvc" / "tmp" / "exps" / "tmp1"
    shutil.copytree(project, copy, ignore=shutil.ignore_patterns("mlruns.db", ".dvc"))
    assert home_of(copy) == copy, "not started by DVC"
    monkeypatch.setenv("DVC_ROOT", str(project))
    assert home_of(copy) == project
    assert home_of(project) == project
    with track_stage("solve_lead_field", {}, copy) as tracker:
        tracker.log_artifact(copy / "params-free.txt")
    assert not (copy / "mlruns.db").exists()
    assert "pipeline" in experiments(project)
    assert list((project / "mlartifacts").rglob("params-free.txt"))


@pytest.mark.parametrize("name", ["a b#cü", "what?", "50%41"])
def test_odd_names_of_folders(
    tmp_path: Path,
    empty_store: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    name: str,
) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    folder = tmp_path / name
    folder.mkdir()
    shutil.copy(empty_store, folder / "mlruns.db")
    before = sorted(tmp_path.iterdir())
    with track_stage("solve_lead_field", {}, folder):
        pass
    assert sorted(tmp_path.iterdir()) == before, "nothing is written outside"
    if "?" in name or "%" in name:
        assert "NOTICE [solve_lead_field]: tracking is off" in caplog.text
        assert "set MLFLOW_TRACKING_URI" in caplog.text
    else:
        assert not caplog.text
        assert "pipeline" in experiments(folder)


@pytest.mark.parametrize("what", ["a directory", "a pipe", "another file"])
def test_what_is_no_store_costs_one_notice_and_no_time(
    project: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, what: str
) -> None:
    """MLflow itself tries for 100 s to open a directory, while all other stages wait."""
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    path = project / "mlruns.db"
    {
        "a directory": path.mkdir,
        "a pipe": lambda: os.mkfifo(path),
        "another file": lambda: path.write_text("no database, and long enough to be read as a page" * 100),
    }[what]()
    start = time.monotonic()
    with track_stage("optimize", PARAMS, project) as tracker:
        tracker.log_metrics({"a": 1.0})
    assert time.monotonic() - start < 20, "the import of MLflow takes seconds"
    assert caplog.text.count("mlruns.db: no store of MLflow") == 1
    with pytest.raises(StoreError, match="no store of MLflow"):
        experiments(project)


@pytest.mark.usefixtures("local_store")
def test_who_finds_a_store_that_another_program_holds_is_not_told_to_move_it_away(
    project: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """All earlier runs are in it."""
    with contextlib.closing(sqlite3.connect(project / "mlruns.db", isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        with track_stage("optimize", PARAMS, project) as tracker:
            tracker.log_metrics({"a": 1.0})
    assert caplog.text.count("mlruns.db: another program has locked it") == 1
    assert "move it away" not in caplog.text


@pytest.mark.usefixtures("local_store")
def test_a_store_that_breaks_in_mid_stage_costs_one_notice(
    project: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with track_stage("optimize", PARAMS, project) as tracker:
        tracker.log_metrics({"a": 1.0})
        with contextlib.closing(sqlite3.connect(project / "mlruns.db")) as other:
            other.execute("DROP TABLE metrics")
        tracker.log_metrics({"b": 1.0})
        tracker.log_metrics({"c": 1.0})
    printed = caplog.text
    assert printed.count("NOTICE") == 1
    assert "no such table" in printed


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
    found = stage_dependencies(
        parse_mapping(DVC_FILE, "dvc.yaml", ParamsError), "optimize", {"task": "hand", "method": "sobol"}
    )
    assert found == ["params-free.txt", "data/hand.csv"]
    assert stage_dependencies({}, "optimize", {}) == []


def test_flatten() -> None:
    assert flatten({"a": {"b": 1, "c": {"d": [2]}}, "e": None}) == {"a.b": 1, "a.c.d": [2], "e": None}


def test_a_view_in_the_place_of_the_experiments_is_not_computed(tmp_path: Path) -> None:
    """A store that was handed in: without a look at its tables the list of experiments would never end."""
    with contextlib.closing(sqlite3.connect(tmp_path / "mlruns.db")) as database:
        database.executescript(
            "CREATE VIEW experiments AS WITH RECURSIVE n(experiment_id) AS (SELECT 1 UNION ALL "
            "SELECT experiment_id + 1 FROM n) SELECT 'x' AS name, experiment_id, "
            "'active' AS lifecycle_stage FROM n LIMIT 3;"
        )
    with pytest.raises(StoreError, match="no table of experiments"):
        experiments(tmp_path)


@pytest.mark.usefixtures("local_store")
def test_a_store_that_never_answers_holds_a_stage_no_longer_than_a_server(
    project: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A store that was handed in, with a view in the place of a table that has no row, and no end."""
    with contextlib.closing(sqlite3.connect(project / "mlruns.db")) as database:
        names = [row[1] for row in database.execute("PRAGMA table_info(experiments)")]
        columns = ", ".join("experiment_id" if n == "experiment_id" else f"'x' AS {n}" for n in names)
        database.executescript(
            "DROP TABLE experiments; CREATE VIEW experiments AS WITH RECURSIVE n(experiment_id) AS "
            f"(SELECT 1 UNION ALL SELECT experiment_id + 1 FROM n) SELECT {columns} FROM n "
            "WHERE experiment_id < 0;"
        )
    monkeypatch.setattr("hdsafebo.pipeline.store._LOCK_S", 4.0)
    with track_stage("optimize", PARAMS, project) as tracker:
        tracker.log_metrics({"a": 1.0})
    assert caplog.text.count("NOTICE [optimize]: tracking is off for the rest of this stage") == 1
    assert "has not answered within 4 s" in caplog.text
