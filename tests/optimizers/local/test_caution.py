"""Beta follows the violations that it promised would not happen."""

import numpy as np
import pytest

from hdsafebo.gp.safe_set import beta_of
from hdsafebo.optimizers.local.ascents import AscentSearch
from hdsafebo.optimizers.local.caution import Caution
from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
from hdsafebo.problem import FunctionProblem, Safety
from optimizers.toy import Halving, bowl_problem, observe_initial


def test_what_beta_promises_changes_nothing() -> None:
    caution = Caution()
    for _ in range(9):
        caution = caution.after(0, 10, beta_of(0.98))
    assert caution.excess == -1.0  # no more is earned in advance
    caution = caution.after(1, 10, beta_of(0.98))
    assert caution.excess == pytest.approx(-0.2)
    assert caution.corrected(-2.0, 3.0) == -2.0


def test_violations_in_excess_lower_beta_and_safe_trials_restore_it() -> None:
    caution = Caution().after(3, 10, beta_of(0.95))
    assert caution.corrected(-2.0, 3.0) == pytest.approx(-2.0 - 3.0 * 2.5)
    assert caution.corrected(-2.0, 0.0) == -2.0
    for _ in range(5):
        caution = caution.after(0, 10, beta_of(0.95))
    assert caution.corrected(-2.0, 3.0) == -2.0


def test_a_beta_that_promises_nothing_is_never_lowered() -> None:
    assert Caution().after(10, 10, 40.0).excess == 0.0


def test_only_promised_trials_count() -> None:
    optimizer = HdSafeBOLocal(bowl_problem(), seed=0, embedding=Halving())
    observe_initial(optimizer)
    trials = optimizer.ask(4)
    assert not trials.marked_unsafe.any()
    optimizer.tell(trials, np.zeros(4), [-1.0, -1.0, 1.0, 1.0])
    expected = -2.0 - 3.0 * (2 - 4 * 0.02275)
    assert optimizer.confidence == pytest.approx(expected, abs=1e-4)
    optimizer.tell(optimizer.ask(1), [0.0], [0.0], status=[2])  # failed: neither safe nor a violation
    assert optimizer.confidence == pytest.approx(expected, abs=1e-4)


def violations(seed: int) -> float:
    """Share of violations on a slope that ends in a cliff, which the values above it do not announce."""

    def cliff(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        level = x[:, 0] + 0.1 * np.sin(9 * x).sum(axis=1)
        return level, np.where(level < 0.5, 1.0, -0.2)

    problem = FunctionProblem(cliff, np.stack([np.zeros(6), np.ones(6)]), [Safety("held", 0.0)])
    optimizer = HdSafeBOLocal(problem, seed=seed, embedding=Halving(), empty_safe_set="mark")
    x = np.random.default_rng(seed).uniform(0, 1, (40, 6)) * np.array([0.6, 1, 1, 1, 1, 1])
    optimizer.observe(x, *cliff(x), initial=True)
    for _ in range(8):
        trials = optimizer.ask(10)
        optimizer.tell(trials, *cliff(trials.x))
    asked = optimizer.trials[optimizer.trials.round > 0]
    return float((asked.safety[:, 0] < 0).mean())


@pytest.mark.thorough
def test_cliffs_are_met_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    corrected = np.mean([violations(seed) for seed in range(2)])
    monkeypatch.setattr(AscentSearch, "rate", 0.0)
    without = np.mean([violations(seed) for seed in range(2)])
    assert without > 0.05, without
    assert corrected < 0.6 * without, (corrected, without)
