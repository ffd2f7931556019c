"""A finite set of inputs that may be suggested, with room for inputs outside it that a person chose.

Implements `problem.CandidateSet`. Rows 0 ... N-1 are the set; the rows behind are reserved and are given, in
order of appearance in the log, to points outside the set that were delivered: they are learnt from like
all others and never suggested.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from hdsafebo.session.errors import ProtocolError
from hdsafebo.session.log.state import Point
from hdsafebo.typing import FloatArray, IntArray

RESERVED_ROWS = 4096
NEIGHBOURS = 100


class FiniteSet(ABC):
    """See the module.

    Attributes:
        size: N, number of rows that can be suggested.
        bounds: (2, D) limits of the inputs.
    """

    size: int
    bounds: FloatArray

    def __init__(self, features: FloatArray) -> None:
        self.size = len(features)
        self._features = np.vstack([features, np.zeros((RESERVED_ROWS, features.shape[1]))])
        self._outside: list[Point] = []

    def __len__(self) -> int:
        """N + reserved rows."""
        return len(self._features)

    @property
    def features(self) -> FloatArray:
        """(N + reserved, p) inputs of the kernel."""
        return self._features

    def row(self, point: Point) -> int:
        """Row of a point; a point outside the set gets the next reserved row.

        Raises:
            ProtocolError: no reserved row is left.
        """
        inside = self._row_inside(point)
        if inside is not None:
            return inside
        if point not in self._outside:
            if len(self._outside) == RESERVED_ROWS - 1:  # the last one is for scratch_row
                raise ProtocolError(
                    f"more than {RESERVED_ROWS - 1} different inputs outside the set were tried"
                )
            self._features[self.size + len(self._outside)] = self._features_of([point])[0]
            self._outside.append(point)
        return self.size + self._outside.index(point)

    def scratch_row(self, point: Point) -> int:
        """Row that shows the features of a point until the next call, for looking at it only."""
        inside = self._row_inside(point)
        if inside is not None:
            return inside
        self._features[-1] = self._features_of([point])[0]
        return len(self._features) - 1

    def point(self, row: int) -> Point:
        """The point of a row."""
        return self._point_inside(row) if row < self.size else self._outside[row - self.size]

    def inputs(self, rows: IntArray) -> FloatArray:
        """(k, D) inputs of rows."""
        return self.encode_points([self.point(int(row)) for row in rows])

    def forbidden(self, last: Point | None) -> IntArray:
        """Rows that may not be suggested now: outside the hard limits, or reserved."""
        rows = np.flatnonzero(~self._permitted(last))
        return np.concatenate([rows, np.arange(self.size, self.size + RESERVED_ROWS)])

    def beyond(self, point: Point) -> IntArray:
        """Rows that are not suggested once a point was unsafe: its own, and those that are surely worse."""
        inside = self._row_inside(point)
        return np.array([] if inside is None else [inside], np.int64)

    def neighbours(self, row: int) -> IntArray:
        """Rows that differ least from a row, the most similar ones by their features."""
        squared = ((self._features[: self.size] - self._features[row]) ** 2).sum(axis=1)
        return np.argsort(squared, kind="stable")[:NEIGHBOURS]

    @abstractmethod
    def encode_points(self, points: list[Point]) -> FloatArray:
        """(k, D) inputs of points."""

    @abstractmethod
    def nearest(self, x: FloatArray, taken: IntArray) -> IntArray:
        """(n,) rows nearest to the (n, D) inputs `x`, all different and none of them in `taken`."""

    @abstractmethod
    def _permitted(self, last: Point | None) -> NDArray[np.bool_]:
        """(N,) True for rows within every hard limit after the point `last`."""

    @abstractmethod
    def _row_inside(self, point: Point) -> int | None:
        """Row of a point of the set; None when it is outside."""

    @abstractmethod
    def _point_inside(self, row: int) -> Point:
        """The point of one of the first N rows."""

    @abstractmethod
    def _features_of(self, points: list[Point]) -> FloatArray:
        """(k, p) kernel inputs of points."""
