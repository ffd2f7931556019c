"""Any system: named inputs with limits, outcomes to optimise, safety functions above thresholds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hdsafebo.problem import Safety
from hdsafebo.session.definition import GenericDefinition
from hdsafebo.session.errors import LimitError, RecordingError
from hdsafebo.session.log.state import Point
from hdsafebo.session.measuring.tables import Table
from hdsafebo.session.spaces.space import (
    MAX_INITIAL_TRIALS,
    TIME_COLUMN,
    Measured,
    Report,
    Space,
    check_keys,
    check_times,
    finite,
)
from hdsafebo.typing import FloatArray

_ROUNDING = 1e-9  # relative to an input's range


class GenericSpace(Space):
    """See `Space`. A point is `{"values": [one number per input]}`."""

    takes_recordings = False

    def __init__(self, definition: GenericDefinition) -> None:
        self.definition = definition
        self.targets = tuple(definition.outcomes)
        self.safety = tuple(Safety(s.name, s.threshold) for s in definition.safety)
        self.inputs = tuple(i.name for i in definition.inputs)
        self.entries = (*self.targets, *(s.name for s in definition.safety))
        self.lower, self.upper, self.max_step, self.home = (
            np.array([getattr(i, key) for i in definition.inputs], float)
            for key in ("lower", "upper", "max_step", "home")
        )

    def point(self, data: Mapping[str, Any]) -> Point:
        """One number per input; see `Space.point`."""
        if set(data) != {"values"} or not isinstance(data["values"], list | tuple | np.ndarray):
            raise LimitError(f"a point has values, got {', '.join(map(str, data)) or 'nothing'}")
        if len(data["values"]) != len(self.inputs):
            raise LimitError(
                f"{len(data['values'])} values, expected {len(self.inputs)}: {', '.join(self.inputs)}"
            )
        return {"values": [finite(v, name) for name, v in zip(self.inputs, data["values"], strict=True)]}

    def reach(self, last: Point | None) -> FloatArray:
        """(2, D) box that the next trial may lie in: the hard limits and the largest step from the last."""
        start = self.home if last is None else np.array(last["values"])
        return np.vstack(
            [np.maximum(self.lower, start - self.max_step), np.minimum(self.upper, start + self.max_step)]
        )

    def permitted(self, values: FloatArray, last: Point | None) -> Any:
        """(n,) True where (n, D) inputs are within every limit."""
        low, high = self.reach(last)
        slack = _ROUNDING * (self.upper - self.lower)
        return ((values >= low - slack) & (values <= high + slack)).all(axis=1)

    def breaches(self, point: Point, last: Point | None) -> list[str]:
        """Hard limits exceeded; see `Space.breaches`."""
        low, high = self.reach(last)
        slack = _ROUNDING * (self.upper - self.lower)
        return [
            f"{name} is {value:g}, permitted now {a:g} to {b:g}"
            for name, value, a, b, s in zip(self.inputs, point["values"], low, high, slack, strict=True)
            if not a - s <= value <= b + s
        ]

    def describe(self, point: Point) -> str:
        """Such as `speed=1.2 gain=0.4`, the first eight inputs."""
        shown = [f"{n}={v:.6g}" for n, v in zip(self.inputs, point["values"], strict=True)]
        return " ".join(shown[:8]) + (f" and {len(shown) - 8} more" if len(shown) > 8 else "")

    def parse(self, text: str, base: Point | None) -> Point:
        """`NAME=VALUE` for each input; see `Space.parse`."""
        values = {} if base is None else self.row(base)
        for word in text.split():
            name, equals, number = word.partition("=")
            if not equals or name not in self.inputs:
                raise LimitError(f"{word!r}: expected NAME=VALUE with a name of {', '.join(self.inputs)}")
            try:
                values[name] = float(number)
            except ValueError:
                raise LimitError(f"{word!r}: {number!r} is no number") from None
        missing = [name for name in self.inputs if name not in values]
        if missing:
            raise LimitError(f"values of {', '.join(missing)} are missing")
        return self.point({"values": [values[name] for name in self.inputs]})

    def row(self, point: Point) -> dict[str, float]:
        """One column per input."""
        return dict(zip(self.inputs, point["values"], strict=True))

    def measure(self, report: Report, labels: Mapping[str, str]) -> Measured:
        """Outcomes and safety values as entered; see `Space.measure`."""
        if report.recording is not None:
            raise RecordingError(f"{report.recording[1]}: this kind of session takes values, no recordings")
        return self._split(report.values)

    def initial_trials(self, table: Table) -> list[dict[str, Any]]:
        """One column per input, outcome and safety function, optionally time."""
        table.require([*self.inputs, *self.entries], [TIME_COLUMN], MAX_INITIAL_TRIALS)
        times = check_times(table)
        trials = []
        for row, time in enumerate(times):
            point = self.point({"values": [table.needed(row, name) for name in self.inputs]})
            outside = [
                n
                for n, v, a, b in zip(self.inputs, point["values"], self.lower, self.upper, strict=True)
                if not a <= v <= b
            ]
            if outside:
                raise RecordingError(
                    f"{table.at(row)}: {', '.join(outside)} outside the limits of the session file"
                )
            found = {name: table.number(row, name) for name in self.entries}
            try:
                measured = self._split({name: value for name, value in found.items() if value is not None})
            except RecordingError as error:
                raise RecordingError(f"{table.at(row)}: {error}") from None
            trials.append(
                {
                    "point": point,
                    "outcomes": measured.outcomes,
                    "safety": measured.safety,
                    "details": {},
                    "time": time,
                }
            )
        return trials

    def _split(self, values: Mapping[str, float]) -> Measured:
        """Safety values are needed; outcomes are all there or all missing (a trial without a result)."""
        safety_names = tuple(s.name for s in self.safety)
        measured = any(name in values for name in self.targets)
        check_keys(values, self.entries if measured else safety_names, "values of")
        try:
            numbers = {name: finite(value, name) for name, value in values.items()}
        except LimitError as error:
            raise RecordingError(str(error)) from None
        outcomes = {name: numbers[name] for name in self.targets} if measured else None
        return Measured(outcomes, {name: numbers[name] for name in safety_names})
