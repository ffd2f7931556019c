"""Thompson sampling over rows of the whole set."""

import numpy as np
import pytest

from hdsafebo.optimizers.controls.thompson_rows import ThompsonRows
from optimizers.toy import observe_initial, rows_problem, run_rounds


def test_rows_are_believed_safe_and_the_best_is_found() -> None:
    optimizer = ThompsonRows(rows_problem(), seed=0)
    observe_initial(optimizer, 20)
    run_rounds(optimizer, 6, 5)
    asked = optimizer.trials[~optimizer.trials.initial]
    assert len(np.unique(optimizer.trials.candidate)) == len(optimizer.trials)
    kept = asked[~asked.marked_unsafe]
    assert (kept.predicted_safe_probability >= 0.977).all()
    points = optimizer.problem.candidates.features
    objective, safety = optimizer.problem.function(points)
    best = objective[safety >= 0].max()
    assert optimizer.best().objective == pytest.approx(best, abs=1e-3)


def test_a_kernel_input_of_a_point_outside_the_set_is_that_of_its_nearest_row() -> None:
    problem = rows_problem()
    optimizer = ThompsonRows(problem, seed=0)
    x = problem.candidates.features[[7]] + 1e-6
    optimizer.observe(x, *problem.function(x), initial=True)
    np.testing.assert_array_equal(optimizer.kernel_inputs(optimizer.trials), problem.candidates.features[[7]])
