"""Packed tables: exact, small where rows are steps from earlier rows, and refused when damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import ProblemError, StateFileError
from hdsafebo.optimizers.core.packing import pack, steps_of, unpack
from hdsafebo.optimizers.core.state_file import read_state, write_state
from hdsafebo.optimizers.registry import load_optimizer, make_optimizer
from hdsafebo.problem import FunctionProblem, LinearFeatures, Safety, check_problem


def walk(n: int, d: int, size: float, rng: np.random.Generator) -> np.ndarray:
    """Each row a step from one of the rows before it."""
    rows = [rng.normal(0, 100, d)]
    for _ in range(n - 1):
        rows.append(rows[rng.integers(len(rows))] + rng.normal(0, size, d))
    return np.rint(rows).clip(-32768, 32767).astype(np.int16)


@pytest.mark.parametrize("size", [0.0, 5.0, 20_000.0])
def test_what_is_packed_comes_back(size: float) -> None:
    table = walk(30, 1001, size, np.random.default_rng(0))
    table[-1, :2] = [-32768, 32767]
    np.testing.assert_array_equal(unpack(pack(table), 1001), table)


def test_steps_take_the_bits_that_they_have() -> None:
    """A Gaussian of deviation s has log2(s sqrt(2 pi e)) bits: 4.4 for 5."""
    table = walk(60, 20_000, 5.0, np.random.default_rng(1))
    bits = 8 * len(pack(table)["bytes"]) / table.size
    assert bits < 1.1 * np.log2(5.0 * np.sqrt(2 * np.pi * np.e)) + 0.2


def test_only_multiples_are_steps() -> None:
    resolution = np.array([0.5, 2.0])
    found = steps_of(np.array([[1.5, -4.0], [0.0, 2.0]]), resolution)
    assert found is not None
    assert found.tolist() == [[3, -2], [0, 1]]
    assert steps_of(np.array([[1.4, 2.0]]), resolution) is None
    assert steps_of(np.array([[0.5, 1e9]]), resolution) is None


@pytest.mark.parametrize(
    ("part", "value"),
    [
        ("lengths", np.array([3, -1])),
        ("lengths", np.array([3])),
        ("references", np.array([-1, 1])),
        ("references", np.array([-2, 0])),
        ("bytes", np.zeros(4, np.uint8)),
    ],
)
def test_parts_that_contradict_each_other_are_refused(part: str, value: np.ndarray) -> None:
    packed = pack(walk(2, 10, 1.0, np.random.default_rng(0)))
    with pytest.raises(ValueError, match="packed rows"):
        unpack(packed | {part: value}, 10)


def wide(resolution: bool = True) -> FunctionProblem:
    rng, d = np.random.default_rng(0), 2000
    matrix = rng.standard_normal((12, d)) / np.sqrt(d)

    def function(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        seen = x @ matrix.T
        return -((seen - 0.3) ** 2).sum(axis=1), 1.0 - np.abs(seen).max(axis=1)

    problem = FunctionProblem(function, np.stack([-np.ones(d), np.ones(d)]), [Safety("margin", 0.0)])
    problem.features = LinearFeatures(matrix)
    problem.depends_on_history = False
    if resolution:
        problem.resolution = np.full(d, 2.0**-8)
    return problem


def test_a_saved_search_on_a_grid_goes_on_to_the_bit(tmp_path: Path) -> None:
    problem, path = wide(), tmp_path / "state"
    optimizer = make_optimizer("hdsafebo_local", problem, seed=0)
    x = np.rint(0.1 * np.random.default_rng(1).standard_normal((20, 2000)) * 256) / 256
    optimizer.observe(x, *problem.function(x), initial=True)
    for _ in range(2):
        trials = optimizer.ask(5)
        np.testing.assert_array_equal(trials.x * 256, np.rint(trials.x * 256))
        optimizer.tell(trials, *problem.function(trials.x))
    optimizer.save(path)
    assert path.stat().st_size < optimizer.trials.x.nbytes / 3
    again = load_optimizer("hdsafebo_local", path, problem)
    np.testing.assert_array_equal(again.trials.x, optimizer.trials.x)
    np.testing.assert_array_equal(again.ask(5).x, optimizer.ask(5).x)
    with pytest.raises(StateFileError, match="multiples of a resolution, and the problem has none"):
        load_optimizer("hdsafebo_local", path, wide(resolution=False))


def test_points_off_the_grid_are_kept_as_they_are(tmp_path: Path) -> None:
    problem, path = wide(), tmp_path / "state"
    optimizer = make_optimizer("hdsafebo_local", problem, seed=0)
    x = 0.1 * np.random.default_rng(1).standard_normal((20, 2000))
    optimizer.observe(x, *problem.function(x), initial=True)
    optimizer.save(path)
    np.testing.assert_array_equal(load_optimizer("hdsafebo_local", path, problem).trials.x, x)


def test_damaged_packed_inputs_are_an_error(tmp_path: Path) -> None:
    problem, path = wide(), tmp_path / "state"
    optimizer = make_optimizer("hdsafebo_local", problem, seed=0)
    x = np.zeros((3, 2000))
    x[:, 0] = [0.0, 0.25, 0.5]
    optimizer.observe(x, *problem.function(x), initial=True)
    optimizer.save(path)
    state, arrays = read_state(path)
    write_state(path, state, arrays | {"packed.bytes": np.zeros_like(arrays["packed.bytes"])})
    with pytest.raises(StateFileError, match="damaged state"):
        load_optimizer("hdsafebo_local", path, problem)


@pytest.mark.parametrize(
    ("resolution", "message"),
    [
        (np.full(2000, 0.3), "powers of two"),
        (np.ones(3), r"shape \(3,\)"),
        (np.full(2000, 4.0), "whole multiples"),
    ],
)
def test_impossible_resolutions(resolution: np.ndarray, message: str) -> None:
    problem = wide()
    problem.resolution = resolution
    with pytest.raises(ProblemError, match=message):
        check_problem(problem)
