"""Which safety functions decide what counts as feasible."""

from __future__ import annotations

import numpy as np

from hdsafebo.optimizers.controls.local_random import LocalRandom
from hdsafebo.optimizers.core.growing import GrowingRows
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


def test_rows_grow_in_place_and_codes_without_an_embedding_are_the_inputs() -> None:
    optimizer = LocalRandom(problem())
    tables = []
    for k in range(40):
        optimizer.observe([[0.01 * k, 0.5], [0.01 * k, 0.25]], [k, k], np.ones((2, 3)), initial=True)
        tables.append(optimizer.trials)
    assert all(table.z is table.x for table in tables)
    np.testing.assert_array_equal(optimizer.trials.x[:, 0], np.repeat(0.01 * np.arange(40), 2))
    for k, table in enumerate(tables):
        np.testing.assert_array_equal(table.x, optimizer.trials.x[: 2 * k + 2])
    rooms = {id(table.x.base) for table in tables}
    assert len(rooms) < 10
    some = optimizer.trials[3:5]
    assert some.z is some.x


def test_rows_that_are_given_up_make_room() -> None:
    rows, whole = GrowingRows(), np.arange(12.0).reshape(6, 2)
    three = rows.extended(whole[:2], whole[2:3])
    rows.extended(three, whole[3:5])
    again = rows.extended(three, -whole[3:4])
    np.testing.assert_array_equal(again, np.concatenate([whole[:3], -whole[3:4]]))
    np.testing.assert_array_equal(rows.extended(whole[:1], whole[4:]), whole[[0, 4, 5]])
