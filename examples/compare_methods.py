"""Compare two methods, and two settings of one, with DVC and MLflow, in a copy of the project.

What the script does can be typed as it stands, in a checkout with the environment activated:

    hdsafebo profile smoke                                             # the smallest size of everything
    dvc repro -s optimize_synthetic@hdsafebo optimize_synthetic@sobol  # two stages and nothing else
    dvc exp run -S methods.hdsafebo.beta=0.0 -s optimize_synthetic@hdsafebo
    mlflow ui --backend-store-uri sqlite:///mlruns.db                  # or read it, as `comparison` does

`-s` runs a stage without those it depends on (runs on synthetic functions depend on code alone), `-S` sets a
parameter for one experiment, and every run of a stage item is a run in MLflow with a child run per seed.

    python examples/compare_methods.py [FOLDER]
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pandas as pd

PROJECT = Path(__file__).resolve().parents[1]
COPIED = ("src", "stages", "profiles", "dvc.yaml", "params.yaml", ".dvc/config", ".dvcignore", ".gitignore")


def copy_project(folder: Path) -> None:
    """What the pipeline needs, under git: an experiment of DVC is a commit."""
    for name in COPIED:
        source, target = PROJECT / name, folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
        else:
            shutil.copy2(source, target)


def run(folder: Path, command: str) -> None:
    """Run a command of the environment in the copy."""
    print(f"$ {command}", flush=True)
    tools = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"PATH": tools, "PYTHONPATH": str(folder / "src"), "DVC_NO_ANALYTICS": "1"}
    environment.pop("MLFLOW_TRACKING_URI", None)  # this comparison goes to a store of its own
    subprocess.run(command.split(), cwd=folder, env=environment, check=True)


def comparison(store: Path, task: str) -> pd.DataFrame:
    """Last value of each metric of every run of a task, one row per run, from the MLflow store."""
    import mlflow

    mlflow.set_tracking_uri(f"sqlite:///{store}")
    runs = mlflow.search_runs(experiment_names=[task], order_by=["attributes.start_time ASC"])
    assert isinstance(runs, pd.DataFrame)
    whole = runs[runs["tags.mlflow.parentRunId"].isna()]  # children are the seeds
    names = {
        "tags.method": "method",
        "params.settings.beta": "beta",
        "metrics.best_safe_objective": "objective",
        "metrics.safety_ratio": "safety",
        "metrics.cumulative_violation": "violation",
    }
    return whole.reindex(columns=list(names)).rename(columns=names).reset_index(drop=True)


def main(folder: Path) -> pd.DataFrame:
    """Run the comparison in an empty folder; returns what MLflow recorded."""
    copy_project(folder)
    run(folder, "git init --quiet")
    run(folder, "hdsafebo profile smoke --force")
    run(folder, "git add --all")
    run(folder, "git -c user.name=example -c user.email=example@example.org commit --quiet -m start")
    run(folder, "dvc repro -s optimize_synthetic@hdsafebo optimize_synthetic@sobol")
    run(folder, "dvc exp run -S methods.hdsafebo.beta=0.0 -s optimize_synthetic@hdsafebo")
    table = comparison(folder / "mlruns.db", "synthetic")
    print(table.to_string(index=False))
    return table


if __name__ == "__main__":
    if len(sys.argv) > 1:
        Path(sys.argv[1]).mkdir(parents=True)
        main(Path(sys.argv[1]).resolve())
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
