"""Which safety functions decide what counts as feasible."""

from __future__ import annotations

import numpy as np

from hdsafebo.optimizers.controls.local_random import LocalRandom
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.typing import FloatArray

FUNCTIONS = (
    Safety("modelled", 0.0, reported=False),
    Safety("reported", 0.0, modelled=False),
    Safety("on_record", 0.0, modelled=False, reported=False),
)


def problem() -> FunctionProblem:
    def function(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return x[:, 0], np.zeros((len(x), 3))

    return FunctionProblem(function, [[0.0, 0.0], [1.0, 1.0]], FUNCTIONS)


def test_functions_that_are_neither_modelled_nor_reported_bind_nobody() -> None:
    optimizer = LocalRandom(problem())
    safety = [[1.0, 1.0, -1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, 1.0]]
    optimizer.observe([[0.1, 0.0], [0.2, 0.0], [0.3, 0.0]], [1.0, 2.0, 3.0], safety, initial=True)
    np.testing.assert_array_equal(optimizer.feasible, [True, False, False])
    assert optimizer.best().id == 0


def test_least_violation_counts_what_binds() -> None:
    optimizer = LocalRandom(problem(), empty_safe_set="mark")
    safety = [[-2.0, 1.0, 1.0], [-1.0, 1.0, -50.0]]
    optimizer.observe([[0.1, 0.0], [0.2, 0.0]], [1.0, 2.0], safety, initial=True)
    assert optimizer.centre_row() == 1
