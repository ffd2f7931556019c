"""What the command line starts."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hdsafebo.cli import main


def test_mlflow_prints_the_page_of_each_experiment_and_starts_one_server(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    started: list[list[str]] = []
    monkeypatch.setattr(os, "execv", lambda program, command: started.append(command))
    monkeypatch.setattr(os, "environ", {})
    monkeypatch.setattr("hdsafebo.pipeline.store.experiments", lambda root: {"synthetic": "2"})
    main(["--root", str(tmp_path), "mlflow", "--port", "5123"])
    address = "http://127.0.0.1:5123/#/experiments/2?workflowType=machine_learning"
    assert capsys.readouterr().out == f"synthetic: {address}\n"
    (command,) = started
    assert command[command.index("--workers") + 1] == "1"
    assert str(tmp_path) in command[command.index("--backend-store-uri") + 1]
    assert os.environ["MLFLOW_SERVER_ENABLE_JOB_EXECUTION"] == "false"
