"""A study in MLflow's own store."""

from __future__ import annotations

from pathlib import Path

import pytest
from mlflow.tracking import MlflowClient
from system.small import box_starts, box_system, run_box

from hdsafebo import Study
from hdsafebo.integrations.mlflow_callback import MLflowCallback

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the libraries below MLflow


def test_each_trial_is_logged_once_also_after_a_restart(tmp_path: Path) -> None:
    uri = f"sqlite:///{tmp_path / 'store.db'}"
    study = Study.open(tmp_path / "s", box_system(), alpha=0.95)
    study.observe(box_starts())
    runs = []
    for _ in range(2):
        suggestion = study.ask()
        study.tell(suggestion, run_box(suggestion.setting))
        runs.append(MLflowCallback("arm", uri)(study))
        study = Study.open(tmp_path / "s")
    study.tell(study.ask(), failed=True)
    runs.append(MLflowCallback("arm", uri)(study))
    assert len(set(runs)) == 1
    client = MlflowClient(uri)
    table = study.to_dataframe()
    gains = client.get_metric_history(runs[0], "gain")
    assert [m.step for m in gains] == list(range(10))
    assert [m.value for m in gains] == pytest.approx(table["gain"].iloc[:10].tolist())
    assert [m.value for m in client.get_metric_history(runs[0], "failed")] == [0.0] * 10 + [1.0]
    run = client.get_run(runs[0])
    assert run.data.params == {"method": "hdsafebo_local", "seed": "0", "alpha": "0.95"}
    assert run.data.metrics["best_safe"] == table["gain"][table["safe"]].max()
