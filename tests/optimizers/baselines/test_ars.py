"""Augmented random search climbs, whatever the scale of the returns, and regards no safety."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.optimizers.baselines.ars import Ars
from hdsafebo.problem import FunctionProblem
from hdsafebo.trials import Status
from hdsafebo.typing import FloatArray

START = np.full((1, 6), 0.2)


def problem(scale: float = 1.0) -> FunctionProblem:
    """A hill at 0.6; everything is safe."""

    def function(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return -scale * ((x - 0.6) ** 2).sum(axis=1), np.ones(len(x))

    return FunctionProblem(function, np.stack([np.zeros(6), np.ones(6)]))


def started(scale: float = 1.0, **settings: float) -> Ars:
    optimizer = Ars(problem(scale), seed=0, **settings)
    optimizer.observe(START, *optimizer.problem.function(START), initial=True)
    return optimizer


def rounds(optimizer: Ars, number: int, batch: int = 10) -> None:
    for _ in range(number):
        trials = optimizer.ask(batch)
        optimizer.tell(trials, *optimizer.problem.function(trials.x))


def test_it_climbs_to_the_top() -> None:
    optimizer = started(noise=0.02, step=0.02)
    rounds(optimizer, 80)
    np.testing.assert_allclose(optimizer._present(), 0.6, atol=0.06)


def test_directions_come_with_their_opposites() -> None:
    trials = started().ask(7)
    np.testing.assert_allclose(trials.x[:3] + trials.x[3:6], 2 * np.repeat(START, 3, axis=0), atol=1e-12)
    assert np.abs(trials.x[6:] - START).max() > 0


def test_a_step_is_that_of_the_paper() -> None:
    optimizer = started(noise=0.02, step=0.05, best=0.5)
    trials = optimizer.ask(8)
    returns, _ = optimizer.problem.function(trials.x)
    up, down, directions = returns[:4], returns[4:], (trials.x[:4] - START) / 0.02
    best = np.argsort(-np.maximum(up, down))[:2]
    deviation = np.concatenate([up[best], down[best]]).std()
    expected = START[0] + 0.05 / (2 * deviation) * (up[best] - down[best]) @ directions[best]
    optimizer.tell(trials, returns, np.ones(8))
    np.testing.assert_allclose(optimizer._present(), np.clip(expected, 0.0, 1.0), atol=1e-9)


def test_the_scale_of_returns_changes_nothing() -> None:
    one, other = started(1.0), started(1000.0)
    rounds(one, 5)
    rounds(other, 5)
    np.testing.assert_allclose(one._present(), other._present(), rtol=1e-9)


def test_directions_with_a_failed_side_are_left_out() -> None:
    optimizer = started()
    trials = optimizer.ask(4)
    returns, safety = optimizer.problem.function(trials.x)
    failed = [Status.COMPLETED, Status.FAILED, Status.COMPLETED, Status.COMPLETED]
    optimizer.tell(trials, returns, safety, status=failed)
    moved = optimizer._present() - START[0]
    direction = trials.x[0] - trials.x[2]
    np.testing.assert_allclose(np.abs(moved @ direction), np.linalg.norm(moved) * np.linalg.norm(direction))
    trials = optimizer.ask(2)
    before = optimizer._present()
    optimizer.tell(trials, np.zeros(2), np.zeros(2), status=[Status.FAILED, Status.FAILED])
    np.testing.assert_array_equal(optimizer._present(), before)


def test_it_goes_on_from_a_file(tmp_path: Path) -> None:
    optimizer = started()
    rounds(optimizer, 3)
    optimizer.save(tmp_path / "state")
    loaded = Ars.load(tmp_path / "state", optimizer.problem)
    np.testing.assert_array_equal(loaded.ask(4).x, optimizer.ask(4).x)


def test_impossible_settings() -> None:
    with pytest.raises(ParamsError, match="setting 'best'"):
        started(best=0.0)
