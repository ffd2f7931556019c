"""The rows of a table as the only inputs that may be suggested."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdsafebo.session.candidates.finite_set import FiniteSet
from hdsafebo.session.errors import RecordingError
from hdsafebo.session.log.state import Point
from hdsafebo.session.measuring.tables import MeasuredTable
from hdsafebo.session.spaces.generic import GenericSpace
from hdsafebo.typing import FloatArray, IntArray


class ListSet(FiniteSet):
    """See the module. Features are the inputs, each divided by the width of its limits.

    Args:
        space: inputs and limits.
        values: (N, D) the table's rows.
    """

    def __init__(self, space: GenericSpace, values: FloatArray) -> None:
        self._space = space
        self._values = values
        width = space.upper - space.lower
        self._width = np.where(width > 0, width, 1.0)
        self._index = {_key(row): i for i, row in enumerate(values)}
        self.bounds = np.vstack([space.lower, space.upper])
        super().__init__(values / self._width)

    def encode_points(self, points: list[Point]) -> FloatArray:
        """The inputs themselves."""
        return np.array([p["values"] for p in points], float).reshape(-1, len(self._width))

    def nearest(self, x: FloatArray, taken: IntArray) -> IntArray:
        """Rows nearest in inputs divided by the width of their limits."""
        free = np.setdiff1d(np.arange(self.size), taken)
        rows = []
        for point in x / self._width:
            squared = ((self.features[free] - point) ** 2).sum(axis=1)
            rows.append(free[int(np.argmin(squared))])
            free = free[free != rows[-1]]
        return np.array(rows, np.int64)

    def _permitted(self, last: Point | None) -> NDArray[np.bool_]:
        return self._space.permitted(self._values, last)

    def _row_inside(self, point: Point) -> int | None:
        return self._index.get(_key(np.asarray(point["values"], float)))

    def _point_inside(self, row: int) -> Point:
        return {"values": self._values[row].tolist()}

    def _features_of(self, points: list[Point]) -> FloatArray:
        return self.encode_points(points) / self._width


def candidate_values(table: MeasuredTable, space: GenericSpace) -> FloatArray:
    """(N, D) rows of a candidate table, checked against the limits.

    Raises:
        RecordingError: a wrong column or value, a row outside the limits, or twice the same; names the line.
    """
    table.require(list(space.inputs), [])
    if not len(table):
        raise RecordingError(f"{table.source}: no rows, expected at least one candidate")
    values = table.numbers(space.inputs)
    outside = (values < space.lower) | (values > space.upper)
    for row in np.flatnonzero(outside.any(axis=1))[:1]:
        names = ", ".join(n for n, out in zip(space.inputs, outside[row], strict=True) if out)
        raise RecordingError(f"{table.at(row)}: {names} outside the limits of the session file")
    seen: dict[bytes, int] = {}
    for row, key in enumerate(map(_key, values)):
        first = seen.setdefault(key, row)
        if first != row:
            raise RecordingError(f"{table.at(row)}: the same as line {table.lines[first]}")
    return values


def _key(row: FloatArray) -> bytes:
    """The numbers of a row (D,) as something that can be looked up; 0.0 and -0.0 are one number."""
    return (row + 0.0).tobytes()
