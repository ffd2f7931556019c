"""The control covers the box evenly and, on a finite set, draws every row equally often."""

import numpy as np
import pytest

from hdsafebo.optimizers.controls.local_random import LocalRandom
from hdsafebo.optimizers.controls.sobol import Sobol, sobol_points
from optimizers.toy import bowl_problem, observe_initial, rows_problem, run_rounds


def test_longer_sequence_begins_with_the_shorter() -> None:
    np.testing.assert_array_equal(sobol_points(5, 7, 3), sobol_points(100, 7, 3)[:5])


def test_more_dimensions_than_sobol_numbers_are_drawn_uniformly() -> None:
    points = sobol_points(6, 30_000, 3)
    np.testing.assert_array_equal(points[:4], sobol_points(4, 30_000, 3))
    assert points.mean() == pytest.approx(0.5, abs=0.01)
    assert (points.min(), points.max()) == (pytest.approx(0.0, abs=1e-3), pytest.approx(1.0, abs=1e-3))


def test_rounds_continue_one_sequence() -> None:
    optimizer = Sobol(bowl_problem(), seed=0)
    run_rounds(optimizer, 8, 8)
    x = optimizer.trials.x
    assert len(x) == 64
    # 64 points of one sequence put exactly one into each 64th of every coordinate.
    for column in x.T:
        assert len(set(np.floor(column * 64))) == 64


def test_rows_are_drawn_uniformly() -> None:
    counts = np.zeros(40)
    for seed in range(300):
        optimizer = Sobol(rows_problem(40), seed=seed)
        counts[optimizer.ask(10).candidate] += 1
    # Each row is drawn with probability 1/4: 75 times, standard deviation 7.5.
    assert (np.abs(counts - 75) < 5 * 7.5).all()


def test_local_steps_have_every_scale_around_the_best_safe_point() -> None:
    optimizer = LocalRandom(bowl_problem(), seed=0)
    observe_initial(optimizer)
    centre = optimizer.best().x
    steps = np.linalg.norm(optimizer.ask(400).x - centre, axis=1) / 2.0  # sqrt(d) = 2
    assert np.quantile(steps, 0.1) < 0.01
    assert np.quantile(steps, 0.9) > 0.1
