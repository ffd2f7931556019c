"""The sampler within Optuna itself: storage, enqueued trials, constraints, failures."""

from __future__ import annotations

from pathlib import Path

import pytest

optuna = pytest.importorskip("optuna")

from hdsafebo.errors import NoSafePointError  # noqa: E402
from hdsafebo.integrations.optuna_sampler import HdSafeBOSampler  # noqa: E402
from hdsafebo.system.errors import DescriptionError  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore::optuna.exceptions.ExperimentalWarning")
optuna.logging.set_verbosity(optuna.logging.ERROR)


def objective(trial) -> float:
    a = trial.suggest_float("a", 0.0, 10.0)
    n = trial.suggest_int("n", 0, 10)
    pad = trial.suggest_categorical("pad", ["x", "y", "z"])
    trial.set_constraint("load", a + n - 12.0)
    return (a - 7.0) ** 2 + (n - 7) ** 2 + {"x": 0.0, "y": 1.0, "z": 3.0}[pad]


def begin(sampler: HdSafeBOSampler, **more) -> optuna.Study:
    study = optuna.create_study(sampler=sampler, **more)
    for i in range(10):
        study.enqueue_trial({"a": 0.4 * i, "n": i % 4, "pad": "xyz"[i % 3]})
    return study


def test_optimizes_within_the_constraint(tmp_path: Path) -> None:
    storage = f"sqlite:///{tmp_path / 'trials.db'}"
    study = begin(HdSafeBOSampler(alpha=0.95), storage=storage, study_name="arm")
    study.optimize(objective, n_trials=20)
    resumed = optuna.load_study(study_name="arm", storage=storage, sampler=HdSafeBOSampler(alpha=0.95))
    resumed.optimize(objective, n_trials=8)  # what is in the storage is all that a sampler needs
    trials = resumed.get_trials()
    assert len(trials) == 28
    loads = [t.constraints["load"] for t in trials]
    assert sum(load > 0 for load in loads) <= 1
    assert min(t.value for t in trials if t.constraints["load"] <= 0) < 4.0
    assert all(isinstance(t.params["n"], int) for t in trials)


def test_failed_trials_teach() -> None:
    study = begin(HdSafeBOSampler(alpha=0.9))
    study.optimize(objective, n_trials=10)
    trial = study.ask()
    params = [trial.suggest_float("a", 0, 10), trial.suggest_int("n", 0, 10)]
    trial.suggest_categorical("pad", ["x", "y", "z"])
    study.tell(trial, state=optuna.trial.TrialState.FAIL)
    again = study.ask()
    assert [again.suggest_float("a", 0, 10), again.suggest_int("n", 0, 10)] != params


def test_without_safe_trials_nothing_is_drawn() -> None:
    study = optuna.create_study(sampler=HdSafeBOSampler())
    with pytest.raises(NoSafePointError, match="enqueue safe trials first"):
        study.optimize(objective, n_trials=1)
    silent = begin(HdSafeBOSampler())
    silent.optimize(lambda t: t.suggest_float("a", 0, 10) + t.suggest_int("n", 0, 10), n_trials=10)
    with pytest.raises(NoSafePointError, match="no trial has reported a limit"):
        silent.ask().suggest_float("a", 0, 10)


def test_several_objectives_are_refused() -> None:
    study = begin(HdSafeBOSampler(), directions=["minimize", "minimize"])
    with pytest.raises(DescriptionError, match="2 objectives"):
        study.ask()
