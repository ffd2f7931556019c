"""Between the user's values and the box [0, 1]^D that optimisers search.

The columns of the box are those of the parameters, then those of the contexts. Where a point of the box can
be run, decoding and encoding it gives the same point, also where somebody set a value between steps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdsafebo.system.description import System
from hdsafebo.system.parameters import Parameter, Real
from hdsafebo.typing import FloatArray

Values = Mapping[str, NDArray[np.float64]]
"""Checked values by name: numbers, positions of choices, zeros of what is fixed."""


class BoxCodec:
    """See the module.

    Args:
        system: whose values they are.

    Attributes:
        parts: parameters, then contexts.
        columns: the columns of each part, by name.
        bounds: (2, D) of the box.
        contexts: the columns that are known and not chosen.
    """

    def __init__(self, system: System) -> None:
        self.system = system
        self.parts: tuple[Parameter, ...] = (*system.parameters, *system.contexts)
        ends = np.cumsum([p.width for p in self.parts]).tolist()
        self.columns = {p.name: slice(end - p.width, end) for p, end in zip(self.parts, ends, strict=True)}
        self.dimension = ends[-1]
        self.bounds = np.stack([np.zeros(self.dimension), np.ones(self.dimension)])
        first = sum(p.width for p in system.parameters)
        self.contexts = tuple(range(first, self.dimension))
        self._real = [p for p in system.parameters if isinstance(p, Real)]

    def check(
        self, table: Mapping[str, Sequence[Any]], parts: Sequence[Parameter], *, exact: bool = False
    ) -> dict[str, FloatArray]:
        """Checked values of the parts that a table has columns for; see `Real.check`."""
        return {p.name: p.check(table[p.name], exact=exact) for p in parts if p.name in table}

    def encode(self, values: Values, parts: Sequence[Parameter] | None = None) -> FloatArray:
        """(n, D') columns of checked values: of all parts, or of some."""
        return np.hstack([p.encode(values[p.name]) for p in (self.parts if parts is None else parts)])

    def decode(self, x: FloatArray) -> dict[str, FloatArray]:
        """Checked values of (n, D) points of the box."""
        return {p.name: p.decode(x[:, self.columns[p.name]]) for p in self.parts}

    def records(self, x: FloatArray) -> list[dict[str, Any]]:
        """One mapping from names to plain values per point of the box."""
        values = self.decode(x)
        return [{p.name: p.python(values[p.name][i]) for p in self.parts} for i in range(len(x))]

    def table(self, x: FloatArray) -> dict[str, list[Any]]:
        """Columns of plain values by name."""
        values = self.decode(x)
        return {p.name: [p.python(v) for v in values[p.name]] for p in self.parts}

    def land(self, x: FloatArray) -> FloatArray:
        """(n, D) nearest points that can be run: on steps, at choices, within the linear constraints."""
        landed = x.copy()
        for part in self.system.parameters:
            columns = self.columns[part.name]
            landed[:, columns] = part.land(x[:, columns])
        if self.system.constraints:
            raw = np.column_stack([p.between_steps(x[:, self.columns[p.name]]) for p in self._real])
            settled = self.system.feasible.land(raw)
            for j, part in enumerate(self._real):
                landed[:, self.columns[part.name]] = part.encode(settled[:, j])
        return landed

    def neighbours(self, x: FloatArray) -> FloatArray:
        """(k, D) points that can be run, one step of one parameter, or another choice, from the (D,) one."""
        points = []
        for part in self.system.parameters:
            columns = self.columns[part.name]
            for value in part.beside(float(part.decode(part.land(x[None, columns]))[0])):
                point = x.copy()
                point[columns] = part.encode(np.array([value]))[0]
                points.append(point)
        return self.land(np.array(points)) if points else np.empty((0, len(x)))

    @property
    def lands(self) -> bool:
        """Whether `land` moves any point."""
        return bool(self.system.constraints) or any(
            p.width and getattr(p, "spacing", None) is not None for p in self.system.parameters
        )
