"""Small problems for tests of optimisers."""

from __future__ import annotations

import numpy as np

from hdsafebo.optimizers.base import Optimizer
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray, IntArray

DIMENSION = 4


def bowl(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Objective with its top at 0.6, safe within a ball about 0.4."""
    return -((x - 0.6) ** 2).sum(axis=1), 0.25 - ((x - 0.4) ** 2).sum(axis=1)


def bowl_problem(threshold: float = 0.0, dimension: int = DIMENSION) -> FunctionProblem:
    """`bowl` over the unit cube."""
    bounds = np.stack([np.zeros(dimension), np.ones(dimension)])
    return FunctionProblem(bowl, bounds, [Safety("distance", threshold)], name="bowl")


class Rows:
    """A finite candidate set: points of a grid, whose features are the points."""

    def __init__(self, points: FloatArray) -> None:
        self.features = points

    def __len__(self) -> int:
        return len(self.features)

    def inputs(self, rows: IntArray) -> FloatArray:
        """Points of the rows."""
        return self.features[rows]

    def weakest(self) -> IntArray:
        """Rows in the lowest tenth of the first coordinate."""
        return np.argsort(self.features[:, 0])[: len(self.features) // 10]

    def nearest(self, x: FloatArray, taken: IntArray) -> IntArray:
        """Greedily the nearest free row of each input."""
        free = np.ones(len(self.features), bool)
        free[taken] = False
        rows = np.empty(len(x), np.int64)
        for i, point in enumerate(x):
            distance = ((self.features - point) ** 2).sum(axis=1)
            distance[~free] = np.inf
            rows[i] = distance.argmin()
            free[rows[i]] = False
        return rows


def rows_problem(n: int = 400, seed: int = 0, dimension: int = 2) -> FunctionProblem:
    """`bowl` over n random points only."""
    problem = bowl_problem(dimension=dimension)
    problem.candidates = Rows(np.random.default_rng(seed).random((n, dimension)))
    return problem


def observe_initial(optimizer: Optimizer, n: int = 12, seed: int = 0) -> Trials:
    """Give an optimiser n evaluated initial trials."""
    problem = optimizer.problem
    assert isinstance(problem, FunctionProblem)
    x, rows = problem.initial(n, np.random.default_rng(seed))
    return optimizer.observe(x, *problem.function(x), candidate=rows, initial=True)


def run_rounds(optimizer: Optimizer, rounds: int, n: int = 4) -> None:
    """Ask, evaluate and tell."""
    problem = optimizer.problem
    assert isinstance(problem, FunctionProblem)
    for _ in range(rounds):
        trials = optimizer.ask(n)
        optimizer.tell(trials, *problem.function(trials.x))


class Halving:
    """An affine embedding of the cube: codes are half of the inputs."""

    def encode(self, x: FloatArray) -> FloatArray:
        """Half."""
        return x / 2

    def decode(self, z: FloatArray) -> FloatArray:
        """Twice."""
        return 2 * z
