"""The coordinates that constrained ascents search: inputs themselves, or what kernel inputs see of them.

In both, initial trials fill the unit cube. In the second, the search may leave it, and a step moves the
inputs by no more than the kernel inputs demand: what they hide stays as it is at the incumbent.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from hdsafebo.optimizers.base import Optimizer
from hdsafebo.problem import features_of
from hdsafebo.search.metric import Metric
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray

_BEYOND = 2.0
"""Sides of the cube of the initial trials that a search of kernel inputs may leave it by."""
_RUGGED = 1e-3
"""Least noise ratio there: features are what many numbers have in common, and outcomes are of all of them.
Without it, what differs between neighbours makes length scales short. With ten times as much, the next trials
of the body are predicted better, and a few of them are unsafe (development seeds)."""
_FEW = 0.005
"""Of the largest range of all kernel inputs; less is none."""


class Chart(ABC):
    """Coordinates of points of the searched space.

    Attributes:
        dimension: r.
        low, high: limits of every coordinate.
        least_noise: least noise ratio of the models.
    """

    dimension: int
    low: float = 0.0
    high: float = 1.0
    least_noise: float = 0.0

    @abstractmethod
    def coordinates(self, trials: Trials) -> FloatArray:
        """(n, r) of trials."""

    @abstractmethod
    def points(self, coordinates: FloatArray, incumbent: FloatArray) -> FloatArray:
        """(n, d) points of the unit cube at (n, r) coordinates; `incumbent` (d,) is where steps begin."""

    def arrays(self) -> dict[str, FloatArray]:
        """What does not follow from the problem, by name."""
        return {}

    def restore(self, arrays: dict[str, FloatArray]) -> None:  # noqa: B027 (there may be nothing)
        """Take back what `arrays` gave."""


class OwnInputs(Chart):
    """The searched space's own unit cube, without dimensions that do not vary."""

    def __init__(self, optimizer: Optimizer) -> None:
        self._space = optimizer.space
        self._varying = np.flatnonzero(self._space.width > 0)
        self.dimension = len(self._varying)

    def coordinates(self, trials: Trials) -> FloatArray:
        """(n, r) of trials."""
        return self._space.to_unit(trials.z)[:, self._varying]

    def points(self, coordinates: FloatArray, incumbent: FloatArray) -> FloatArray:
        """(n, d) points of the unit cube, 0 where nothing varies."""
        full = np.zeros((len(coordinates), self._space.dimension))
        full[:, self._varying] = coordinates
        return full


class VisibleSteps(Chart):
    """Kernel inputs, each in units of the range that initial trials have.

    Args:
        metric: from the unit cube to kernel inputs, linearly independent ones.
        optimizer: whose problem has the features, and initial trials that differ.
    """

    low, high = -_BEYOND, 1.0 + _BEYOND
    least_noise = _RUGGED

    def __init__(self, metric: Metric, optimizer: Optimizer) -> None:
        self._metric, self._problem = metric, optimizer.problem
        self.dimension = len(metric.matrix)
        known = self._inputs(optimizer.trials[optimizer.trials.initial])
        self._middle = known.mean(axis=0)
        reach = np.abs(known - self._middle).max(axis=0)
        # Where initial trials hardly differ, nothing says how far is far: as in the others, in the mean.
        few = reach < _FEW * reach.max()
        reach[few] = np.exp(np.log(reach[~few]).mean())
        self._side = 2.0 * reach
        self._steps = np.linalg.solve(metric.matrix @ metric.matrix.T, metric.matrix)

    def coordinates(self, trials: Trials) -> FloatArray:
        """(n, r) of trials."""
        return self._scaled(self._inputs(trials))

    def points(self, coordinates: FloatArray, incumbent: FloatArray) -> FloatArray:
        """(n, d) points of the unit cube, cut to it."""
        here = self._scaled(self._metric.inputs(incumbent[None]))
        return np.clip(incumbent + ((coordinates - here) * self._side) @ self._steps, 0.0, 1.0)

    def arrays(self) -> dict[str, FloatArray]:
        """Centre and sides: initial trials that are told later leave them as they are."""
        return {"chart_middle": self._middle, "chart_side": self._side}

    def restore(self, arrays: dict[str, FloatArray]) -> None:
        """Take back what `arrays` gave."""
        self._middle, self._side = arrays["chart_middle"], arrays["chart_side"]

    def _inputs(self, trials: Trials) -> FloatArray:
        return features_of(self._problem, trials.x)

    def _scaled(self, inputs: FloatArray) -> FloatArray:
        return 0.5 + (inputs - self._middle) / self._side
