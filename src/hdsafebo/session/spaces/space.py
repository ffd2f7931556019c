"""What every kind of session says about its inputs, its hard limits and its results."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np

from hdsafebo.problem import Safety
from hdsafebo.session.definition import Definition
from hdsafebo.session.errors import LimitError, RecordingError
from hdsafebo.session.log.state import Point
from hdsafebo.session.measuring.outcome_scale import OutcomeScale
from hdsafebo.session.measuring.tables import MeasuredTable

TIME_COLUMN = "time"
MAX_INITIAL_TRIALS = 20_000  # twice as many as a suggestion is made for in reasonable time


@dataclass(frozen=True)
class Report:
    """What came back from one trial, as the person at the bench enters it.

    Attributes:
        recording: content and name of a recording file; None when there is none.
        values: measured values by name: scores of the raters, or outcomes and safety values.
    """

    recording: tuple[bytes, str] | None = None
    values: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Measured:
    """Checked results of one trial.

    Attributes:
        outcomes: value of every objective; None when the trial gave none (a missing recording).
        safety: value of every safety function.
        details: the raw values behind them.
    """

    outcomes: dict[str, float] | None
    safety: dict[str, float]
    details: dict[str, Any] = field(default_factory=dict)


class Space(ABC):
    """Inputs, hard limits and results of one kind of session.

    Attributes:
        targets: the objectives.
        safety: the safety functions.
        inputs: names of the input columns of tables.
        entries: names of the values that are asked from people after each trial.
        takes_recordings: whether outcomes come from a recording file.
        scale: on which noisy outcomes are modelled.
    """

    targets: tuple[str, ...]
    safety: tuple[Safety, ...]
    inputs: tuple[str, ...]
    entries: tuple[str, ...]
    takes_recordings: bool
    scale: OutcomeScale = OutcomeScale()

    @abstractmethod
    def point(self, data: Mapping[str, Any]) -> Point:
        """A point from plain data; LimitError when it is malformed."""

    @abstractmethod
    def breaches(self, point: Point, last: Point | None) -> list[str]:
        """Which hard limits a point exceeds, in words.

        Args:
            point: the inputs.
            last: the inputs delivered last; None at a start or after a pause.
        """

    @abstractmethod
    def describe(self, point: Point) -> str:
        """A point in one line."""

    @abstractmethod
    def parse(self, text: str, base: Point | None) -> Point:
        """A point as `describe` writes it; what is left out is taken from `base`.

        Raises:
            LimitError: the text cannot be read.
        """

    @abstractmethod
    def along(self, point: Point, count: int) -> dict[str, list[tuple[float, Point]]]:
        """Points that differ from one in a single quantity, over the range that the hard limits leave it.

        Args:
            point: the inputs.
            count: of points for each quantity.

        Returns:
            For each quantity that varies, its values, increasing, and the points.
        """

    @abstractmethod
    def row(self, point: Point) -> dict[str, float]:
        """A point as named columns."""

    @abstractmethod
    def measure(self, report: Report, labels: Mapping[str, str]) -> Measured:
        """Check what came back.

        Args:
            report: as entered.
            labels: `session` and `trial`, which a recording must not contradict.

        Raises:
            RecordingError: a malformed recording, or a value missing, unknown or out of range.
        """

    @abstractmethod
    def initial_trials(self, table: MeasuredTable) -> list[dict[str, Any]]:
        """Initial trials of a table: point, outcomes, safety, details, time.

        Raises:
            RecordingError: a column or value is wrong; the message names the line.
        """

    @abstractmethod
    def tighten(self, definition: Definition) -> None:
        """Let the hard limits of a definition hold instead of those so far."""

    @abstractmethod
    def check_result(self, result: Mapping[str, Any]) -> None:
        """Check that outcomes and safety values of the log have their names, and follow from the raw values.

        Args:
            result: `outcomes`, `safety` and `details` as an entry of the log holds them.

        Raises:
            RecordingError: one does not.
        """

    def require_permitted(self, point: Point, last: Point | None) -> None:
        """LimitError naming every hard limit that a point exceeds."""
        wrong = self.breaches(point, last)
        if wrong:
            raise LimitError(f"{self.describe(point)} is outside the hard limits: {'; '.join(wrong)}")

    def shown_safety(self, name: str, modelled: float) -> float:
        """A safety value in its own units, from the units it is modelled in (after `Safety.transform`)."""
        return modelled

    def judged(self, safety: Mapping[str, float]) -> list[float]:
        """Safety values in the order and sign of `safety`, larger is safer."""
        return [safety[s.name] for s in self.safety]

    def safe(self, safety: Mapping[str, float]) -> bool:
        """Whether every safety value keeps its limit."""
        values = self.judged(safety)
        return all(value >= s.threshold for value, s in zip(values, self.safety, strict=True))

    def limits(self) -> dict[str, str]:
        """Each safety function's limit in words."""
        return {s.name: f"at least {s.threshold:g}" for s in self.safety}


def finite(value: Any, name: str) -> float:
    """A finite float from plain data; LimitError names what is none."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise LimitError(f"{name}: {value!r} is no number")
    try:
        number = float(value)
    except OverflowError:
        number = float("inf")
    if not np.isfinite(number):
        raise LimitError(f"{name}: {number}, expected a finite number")
    return number


def check_keys(values: Mapping[str, Any], expected: tuple[str, ...], what: str) -> None:
    """RecordingError unless `values` has exactly the expected names."""
    missing = [n for n in expected if n not in values]
    if missing:
        raise RecordingError(f"{what} {', '.join(missing)} missing; expected {', '.join(expected)}")
    unknown = [n for n in values if n not in expected]
    if unknown:
        raise RecordingError(f"{what} {', '.join(unknown)} unknown; expected {', '.join(expected)}")


def check_times(table: MeasuredTable) -> list[str | None]:
    """Times of the rows (ISO 8601) where the table has them; RecordingError where one goes back."""
    if TIME_COLUMN not in table.columns:
        return [None] * len(table)
    times: list[datetime] = []
    for row in range(len(table)):
        text = table.text(row, TIME_COLUMN)
        try:
            time = datetime.fromisoformat(text)
        except ValueError:
            raise RecordingError(
                f"{table.at(row)}, column {TIME_COLUMN}: {text[:40]!r} is no ISO 8601 time"
            ) from None
        if times and (time.tzinfo is None) != (times[-1].tzinfo is None):
            raise RecordingError(
                f"{table.at(row)}, column {TIME_COLUMN}: with and without a time zone are mixed"
            )
        if times and time < times[-1]:
            raise RecordingError(f"{table.at(row)}: time {time} lies before {times[-1]}: times out of order")
        times.append(time)
    return [t.isoformat() for t in times]
