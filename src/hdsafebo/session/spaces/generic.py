"""Any system: named inputs with limits, outcomes to optimise, safety functions above thresholds."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from hdsafebo.problem import Safety
from hdsafebo.session.definition import Definition, GenericDefinition, StimulationDefinition
from hdsafebo.session.errors import LimitError, ProtocolError, RecordingError
from hdsafebo.session.log.state import Point
from hdsafebo.session.measuring.tables import MeasuredTable
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
from hdsafebo.session.words import parse_assignments
from hdsafebo.typing import FloatArray

_FEWEST, _EVERY = 6, 17  # significant digits that are shown; 17 tell every float from its neighbours
_ROUNDING = 1e-9  # relative to the width of what is permitted: a step of 0.7 + 0.1 must not miss 0.8
_LAST_DIGITS = 8 * np.finfo(float).eps  # relative to the largest number that a point is calculated from


class GenericSpace(Space):
    """See `Space`. A point is `{"values": [one number per input]}`.

    Args:
        definition: as the session was made.
        rows: the only values that may be delivered, in a session of a list; None where every point of the
            box may be, or where the list is not at hand.

    Attributes:
        lower, upper: (D,) limits as the session was made, which scale the inputs whatever is in force.
        steps: whether any input may only move in steps.
    """

    takes_recordings = False

    def __init__(
        self, definition: GenericDefinition, rows: Collection[tuple[float, ...]] | None = None
    ) -> None:
        self.rows = rows
        self.targets = tuple(definition.outcomes)
        self._rules = tuple(definition.safety)
        self.safety = tuple(Safety(s.name, s.sign * s.limit) for s in definition.safety)
        self.inputs = tuple(i.name for i in definition.inputs)
        self.entries = (*self.targets, *(s.name for s in definition.safety))
        self.lower, self.upper = _column(definition, "lower"), _column(definition, "upper")
        self.tighten(definition)

    def tighten(self, definition: Definition) -> None:
        """Let the limits of a definition hold; see `Space.tighten`."""
        assert not isinstance(definition, StimulationDefinition)
        self._lowest, self._highest = _column(definition, "lower"), _column(definition, "upper")
        self._max_step = np.array([np.inf if i.max_step is None else i.max_step for i in definition.inputs])
        self.steps = bool(np.isfinite(self._max_step).any())
        self._home = np.array([i.lower if i.home is None else i.home for i in definition.inputs])
        largest = np.maximum(np.abs(self.lower), np.abs(self.upper))
        span = np.minimum(self._highest - self._lowest, self._max_step)
        self._digits = [_digits(*pair) for pair in zip(largest.tolist(), span.tolist(), strict=True)]

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
        start = self._home if last is None else np.array(last["values"])
        return np.vstack(
            [
                np.maximum(self._lowest, start - self._max_step),
                np.minimum(self._highest, start + self._max_step),
            ]
        )

    def permitted(self, values: FloatArray, last: Point | None) -> Any:
        """(n,) True where (n, D) inputs are within every limit."""
        low, high = self.reach(last)
        slack = self._slack(low, high)
        return ((values >= low - slack) & (values <= high + slack)).all(axis=1)

    def breaches(self, point: Point, last: Point | None) -> list[str]:
        """Hard limits exceeded; see `Space.breaches`."""
        low, high = self.reach(last)
        slack = self._slack(low, high)
        foreign = self.rows is not None and tuple(point["values"]) not in self.rows
        return [f"it is none of the {len(self.rows or ())} rows of the list"] * foreign + [
            f"{name} is {value:.{digits}g}, permitted now {a:.{digits}g} to {b:.{digits}g}"
            for name, value, a, b, s, digits in zip(
                self.inputs, point["values"], low, high, slack, self._digits, strict=True
            )
            if not a - s <= value <= b + s
        ]

    def describe(self, point: Point) -> str:
        """Such as `speed=1.2 gain=0.4`, every input; of a list in full, so that the text names the row."""
        return " ".join(f"{n}={self._shown(j, point['values'][j])}" for j, n in enumerate(self.inputs))

    def parse(self, text: str, base: Point | None) -> Point:
        """`NAME=VALUE` for each input; see `Space.parse`."""
        try:
            given = parse_assignments(text.split())
        except ProtocolError as error:
            raise LimitError(str(error)) from None
        unknown = [name for name in given if name not in self.inputs]
        if unknown:
            raise LimitError(f"{', '.join(unknown)} unknown; the inputs are {', '.join(self.inputs)}")
        values = ({} if base is None else self.row(base)) | given
        missing = [name for name in self.inputs if name not in values]
        if missing:
            raise LimitError(f"values of {', '.join(missing)} are missing")
        return self.point({"values": [values[name] for name in self.inputs]})

    def along(self, point: Point, count: int) -> dict[str, list[tuple[float, Point]]]:
        """Along every input; see `Space.along`."""
        lines: dict[str, list[tuple[float, Point]]] = {}
        for j, name in enumerate(self.inputs):
            if self._lowest[j] < self._highest[j]:
                values = np.linspace(self._lowest[j], self._highest[j], count).tolist()
                before, after = point["values"][:j], point["values"][j + 1 :]
                lines[name] = [(v, {"values": [*before, v, *after]}) for v in values]
        return lines

    def judged(self, safety: Mapping[str, float]) -> list[float]:
        """Upper limits with their sign turned; see `Space.judged`."""
        return [rule.sign * safety[rule.name] for rule in self._rules]

    def shown_safety(self, name: str, modelled: float) -> float:
        """In the quantity's own sign; see `Space.shown_safety`."""
        return next(rule.sign for rule in self._rules if rule.name == name) * modelled

    def limits(self) -> dict[str, str]:
        """See `Space.limits`."""
        return {r.name: f"at {'least' if r.sign > 0 else 'most'} {r.limit:g}" for r in self._rules}

    def row(self, point: Point) -> dict[str, float]:
        """One column per input."""
        return dict(zip(self.inputs, point["values"], strict=True))

    def measure(self, report: Report, labels: Mapping[str, str]) -> Measured:
        """Outcomes and safety values as entered; see `Space.measure`."""
        if report.recording is not None:
            raise RecordingError(f"{report.recording[1]}: this kind of session takes values, no recordings")
        return self._split(report.values)

    def check_result(self, result: Mapping[str, Any]) -> None:
        """See `Space.check_result`."""
        self._split({**(result["outcomes"] or {}), **(result["safety"] or {})})

    def initial_trials(self, table: MeasuredTable) -> list[dict[str, Any]]:
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

    def _shown(self, j: int, value: float) -> str:
        """A value of input j as people read and set it; in full where rounding would pass a hard limit."""
        text, low, high = f"{value:.{self._digits[j]}g}", self._lowest[j], self._highest[j]
        passes = low <= value <= high and not low <= float(text) <= high
        return f"{value}" if passes or self.rows is not None else text

    def _slack(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """(D,) by how much rounding may pass the ends of what is permitted now.

        It does not grow with the range an input once had: a step or a tightened limit may be far smaller.
        """
        largest = np.maximum(np.abs(self.lower), np.abs(self.upper))
        return np.asarray(_ROUNDING * np.maximum(high - low, 0.0) + _LAST_DIGITS * largest)

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


def _column(definition: GenericDefinition, key: str) -> FloatArray:
    """(D,) one number of every input."""
    return np.array([getattr(i, key) for i in definition.inputs], float)


def _digits(largest: float, span: float) -> int:
    """Significant digits that values are shown with.

    Six tell them apart in most ranges; in a narrow one far from 0, or where steps are small, the value that
    is shown would be another one than was judged.

    Args:
        largest: size of the largest value.
        span: of what is permitted at once.
    """
    ratio = 1.0 if span == 0.0 else largest / span
    more = math.log10(max(ratio, 1.0))
    return _EVERY if more > _EVERY - _FEWEST else _FEWEST + round(more)
