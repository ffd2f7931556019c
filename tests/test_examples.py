"""The worked examples do what they say."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from report.run_files import trial_table, write_run

from hdsafebo.pipeline.store import default_uri
from hdsafebo.pipeline.tracking import track_stage
from hdsafebo.report.data.metrics import per_seed
from hdsafebo.runs.read import read_run
from hdsafebo.trials import Status


def load(root: Path, name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"example_{name}", root / "examples" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_own_black_box_improves_safely_and_resumes(project_root: Path, tmp_path: Path) -> None:
    example = load(project_root, "own_black_box")
    optimizer = example.optimize(tmp_path / "state.zip")
    trials = optimizer.trials
    chosen = ~trials.initial
    assert 24 < chosen.sum() <= 48, "a batch is shorter where fewer trials are believed safe"
    assert (trials.status[chosen] == Status.FAILED).any(), "the example shows a failed trial"
    done = chosen & trials.completed
    assert optimizer.feasible[done].sum() / done.sum() >= 0.9
    start = trials.objective[trials.initial & optimizer.feasible].max()
    best = optimizer.best()
    assert best.objective > start + 5.0
    assert (best.safety < 1.0).any(), "a limit binds"


def load_named(root: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """An example that imports its stand-ins from beside it."""
    monkeypatch.syspath_prepend(str(root / "examples"))
    return load(root, name)


def test_arm_of_three_robots(project_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    example = load_named(project_root, "arm_gains", monkeypatch)
    study = example.main(tmp_path, trials=20)
    table = study.to_dataframe()
    assert (tmp_path / "progress.png").stat().st_size > 10_000
    assert (table["status"] == "pending").sum() == 3
    chosen = table[~table["initial"] & (table["status"] == "completed")]
    assert chosen["safe"].mean() >= 0.85
    assert chosen["tracking_error"].min() < table["tracking_error"][table["initial"]].min()


def test_gripper_with_a_rule(project_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    example = load_named(project_root, "gripper_mixed", monkeypatch)
    table = example.main(trials=20).to_dataframe()
    assert (2 * table["pulses"] + table["rest"] <= 14).all()
    chosen = table[~table["initial"]]
    assert chosen["safe"].mean() >= 0.85
    assert chosen["error"].min() < table["error"][table["initial"]].min()


def test_crane_with_a_payload_per_day(project_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    example = load_named(project_root, "crane_payload", monkeypatch)
    table = example.main(payloads=(1.0, 1.6, 0.9), per_day=6).to_dataframe()
    chosen = table[~table["initial"]]
    assert chosen["payload"].tolist() == [1.0] * 6 + [1.6] * 6 + [0.9] * 6
    stored = set(example.SETTINGS.itertuples(index=False, name=None))
    assert set(table[list(example.SETTINGS)].itertuples(index=False, name=None)) <= stored
    assert chosen["safe"].mean() >= 0.9


def test_a_session_of_three_robots(
    project_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    example = load_named(project_root, "session_robots", monkeypatch)
    session = example.main(tmp_path, rounds=6)
    later = [t for t in session.state.trials if t.origin == "suggested"]
    assert len(later) == 18
    assert [t.number for t in session.state.trials] == list(range(1, 27))
    safe = [session.space.safe(t.safety) for t in later]
    assert sum(safe) >= 16
    first = max(t.outcomes["speed"] for t in session.state.trials if t.origin == "initial")
    assert session.best().outcomes["speed"] > first + 0.3


def test_a_session_of_stored_settings(project_root: Path, tmp_path: Path) -> None:
    from hdsafebo import create_session

    files = project_root / "examples" / "session_list"
    session = create_session(tmp_path / "s", files / "session.yaml", who="ann", initial=files / "initial.csv")
    suggestion = session.suggest("ann")
    assert tuple(suggestion.point["values"]) in session.space.rows
    assert abs(suggestion.point["values"][0] - 0.4) <= 0.5, "the largest step from home"


def test_the_examples_of_own_systems_are_short(project_root: Path) -> None:
    for name in ("arm_gains", "gripper_mixed", "crane_payload"):
        lines = (project_root / "examples" / f"{name}.py").read_text(encoding="utf-8").splitlines()
        assert len(lines) <= 40, name


def test_reading_run_files_gives_the_reports_numbers(
    project_root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    example = load(project_root, "read_runs")
    rng = np.random.default_rng(0)
    for method, gain in (("hdsafebo", 1.0), ("sobol", 0.0)):
        tables = []
        for seed in range(3):
            objective = gain + rng.normal(size=12)
            objective[7] = np.nan  # a failed trial
            tables.append(trial_table(seed, objective, rng.normal(size=12), n_initial=4, batch=2))
        write_run(tmp_path, "synthetic", method, tables, n_initial=4, batch=2)
    folder = tmp_path / "data/runs"
    run = example.read_run(folder, "synthetic", "hdsafebo")
    expected = per_seed(read_run(folder / "synthetic-hdsafebo.parquet"))
    found = example.per_seed(run)
    for metric in ("objective", "safety", "violation"):
        np.testing.assert_allclose(found[metric], expected[metric])
    curve = example.learning_curve(run)
    assert curve["mean"].iloc[-1] == pytest.approx(found["objective"].mean())
    example.main(folder, "synthetic", ["hdsafebo", "sobol"])
    assert "synthetic hdsafebo: 3 seeds, 12 trials" in capsys.readouterr().out
    other = example.per_seed(example.read_run(folder, "synthetic", "sobol"))
    mean, _, pairs = example.paired_difference(found, other, "objective")
    assert (mean, pairs) == (pytest.approx((found["objective"] - other["objective"]).mean()), 3)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the libraries below MLflow
def test_comparison_reads_what_a_stage_records(
    project_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    for method, settings in (("hdsafebo", {"beta": 2.0}), ("sobol", {})):
        with track_stage("optimize_synthetic", {}, tmp_path) as tracker:
            item = {"task": "synthetic", "method": method}
            tracker.place(
                "synthetic", method, stage="optimize_synthetic", item=item, params={"settings": settings}
            )
            tracker.log_child(f"{method} 0", {}, [10], {"best_safe_objective": [7.0]})
            curves = {"best_safe_objective": [1.0, 3.0], "safety_ratio": [1.0, 0.5]}
            tracker.log_series([10, 20], curves | {"cumulative_violation": [0.0, 2.0]})
    assert default_uri(tmp_path) == f"sqlite:///{tmp_path / 'mlruns.db'}"
    table = load(project_root, "compare_methods").comparison(tmp_path / "mlruns.db", "synthetic")
    assert table["method"].tolist() == ["hdsafebo", "sobol"]
    assert table["beta"].fillna("none").tolist() == ["2.0", "none"]
    assert table[["objective", "safety", "violation"]].to_numpy().tolist() == [[3.0, 0.5, 2.0]] * 2


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("git") is None, reason="DVC's experiments are commits")
def test_comparison_runs_two_methods_and_an_experiment(project_root: Path, tmp_path: Path) -> None:
    table = load(project_root, "compare_methods").main(tmp_path)
    assert table["method"].tolist() == ["hdsafebo", "sobol", "hdsafebo"]
    assert table["beta"].fillna("none").tolist() == ["2.0", "none", "0.0"]
    assert table[["objective", "safety", "violation"]].notna().all().all()


def test_any_environment_is_searched_and_filmed(
    project_root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    example = load(project_root, "any_environment")
    arguments = ["Pendulum-v1", "--steps", "30", "--least-steps", "20", "--initial", "8", "--trials", "12"]
    example.main([*arguments, "--out", str(tmp_path)])
    said = capsys.readouterr().out
    assert "Pendulum-v1: 4 weights" in said
    assert said.count("best safe return") == 3
    assert "safe 100.0 %" in said
    assert "return with seeds that no trial met" in said
    assert (tmp_path / "Pendulum-v1.safetensors").exists()
    assert (tmp_path / "Pendulum-v1.mp4").exists() or "no video" in said


def test_a_mistaken_environment_ends_with_a_message(
    project_root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        load(project_root, "any_environment").main(["CartPole-v1", "--out", str(tmp_path)])
    assert ended.value.code == 2
    assert "action space of 'CartPole-v1' is Discrete; expected a Box" in capsys.readouterr().err
