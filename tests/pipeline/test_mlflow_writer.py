"""What the process writes, called here without one."""

from __future__ import annotations

import platform
from pathlib import Path

import pytest

from hdsafebo.pipeline.mlflow_writer import MlflowWriter
from hdsafebo.pipeline.processes import this_process
from hdsafebo.pipeline.store import default_uri

# What the libraries below MLflow will stop to support is not ours to mend.
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")


def test_a_run_that_was_cut_ends_as_killed_when_its_stage_runs_again(tmp_path: Path) -> None:
    from mlflow.tracking import MlflowClient

    client = MlflowClient(tracking_uri=default_uri(tmp_path))
    place = (tmp_path / "mlartifacts").as_uri()

    def begin(stage: str, process: str) -> MlflowWriter:
        writer = MlflowWriter(client)
        writer.begin("pipeline", place, stage, {"stage": stage, "process": process}, {})
        return writer

    for stage in ("fit_synergies", "solve_lead_field"):
        begin(stage, f"{platform.node()} 1 0.00")  # and then the power failed
    # Side by side, as `dvc exp run --temp` may run them.
    for writer in [begin("solve_lead_field", this_process()) for _ in range(2)]:
        writer.finish("FINISHED")
    runs = client.search_runs([client.get_experiment_by_name("pipeline").experiment_id])
    assert sorted((run.info.run_name, run.info.status) for run in runs) == [
        ("fit_synergies", "RUNNING"), ("solve_lead_field", "FINISHED"), ("solve_lead_field", "FINISHED"),
        ("solve_lead_field", "KILLED"),
    ]  # fmt: skip


def test_more_than_one_call_of_mlflow_takes_is_written_whole(tmp_path: Path) -> None:
    from mlflow.tracking import MlflowClient

    client = MlflowClient(tracking_uri=default_uri(tmp_path))
    writer = MlflowWriter(client)
    params = {f"p{n}": str(n) for n in range(250)} | {"long": "a" * 7000}
    writer.begin("e", (tmp_path / "mlartifacts").as_uri(), "r", {"stage": "s", "process": "p"}, params)
    writer.log_series(list(range(1200)), {"m": [None, *map(float, range(1, 1200))]})
    run = client.search_runs([client.get_experiment_by_name("e").experiment_id])[0]
    assert run.data.params == params | {"long": "a" * 6000}
    assert len(client.get_metric_history(run.info.run_id, "m")) == 1199
