"""Parameters: named quantities that are chosen before a trial, or known before it (contexts).

Each kind says how its values become columns of the box [0, 1]^D in which optimisers search, and which points
of those columns stand for a value that can be set.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from hdsafebo.system.errors import DescriptionError, TableError
from hdsafebo.system.values import Number, check_distinct, check_name, finite, plain_value, set_plain, shown
from hdsafebo.typing import FloatArray

_SLACK = 1e-9
"""Values outside a range by this share of its width are taken for rounding, and cut to the range."""
_DIGITS = 12
"""Significant digits of values that are shown, and of values on steps."""
_FLOAT_DIGITS, _EXACT = 16, 17
"""Significant digits that a float can round to, and digits that tell every float from its neighbours."""
_SPARE = 3
"""Of twelve digits so many may be the same in the whole range: nine tell the values apart, as in the box."""
_ON_STEP = 1e-6
"""Values off the nearest step by this share of a step are taken for rounding."""
_LOST = 16 * float(np.finfo(float).eps)
"""What a value loses on its way into the box and back, as a share of the largest one."""


@dataclass(frozen=True)
class Real:
    """A number within a range.

    Attributes:
        name: column name.
        lower, upper: the range, both ends included, in `unit`.
        unit: of the values; it is shown and never converted.
        log: distances are ratios: 1 to 2 is as far as 10 to 20.
        step: only `lower`, `lower + step`, ... can be set; None means every value.
    """

    name: str
    lower: Number
    upper: Number
    unit: str = ""
    log: bool = False
    step: Number | None = None
    kind: Literal["real"] = field(default="real", kw_only=True)

    def __post_init__(self) -> None:
        check_name(self.name, "a parameter")
        what = f"parameter {self.name!r}"
        set_plain(self, what, "lower", "upper", "step")
        lower, upper = self.lower, self.upper
        if not lower < upper:
            raise DescriptionError(
                f"{what} ranges from {lower:g} to {upper:g}; expected lower < upper (a value that never "
                "changes is a Fixed)"
            )
        if self.log and lower <= 0:
            raise DescriptionError(f"{what} has log=True and lower {lower:g}; expected lower > 0")
        if not math.isfinite(float(upper) - float(lower)):
            raise DescriptionError(
                f"{what} ranges from {lower:g} to {upper:g}; expected a range below 1.8e308"
            )
        if self.step is not None and not 0 < self.step <= upper - lower:
            raise DescriptionError(f"{what}: step is {self.step:g}; expected more than 0, at most the range")

    @property
    def spacing(self) -> float | None:
        """Distance between values that can be set; None when every value can."""
        return self.step

    @property
    def width(self) -> int:
        """Columns of the box."""
        return 1

    def check(self, values: Sequence[Any], *, exact: bool = False) -> FloatArray:
        """(n,) values as numbers within the range.

        Args:
            values: as they stand in a table.
            exact: refuse values between two steps; otherwise they were set, whatever the steps are.

        Raises:
            TableError: one is no number, or out of range, or between two steps.
        """
        numbers = np.array([finite(v, f"row {i}: {self.name}", TableError) for i, v in enumerate(values)])
        slack = _SLACK * (self.upper - self.lower)
        for i in np.flatnonzero((numbers < self.lower - slack) | (numbers > self.upper + slack))[:1]:
            raise TableError(
                f"row {i}: {self.name} is {numbers[i]:g}; expected {self.lower:g} to {self.upper:g}"
                + (f" {self.unit}" if self.unit else "")
            )
        numbers = np.clip(numbers, self.lower, self.upper)
        if exact and self.spacing is not None:
            landed = self.land_values(numbers)
            for i in np.flatnonzero(np.abs(landed - numbers) > _ON_STEP * self.spacing)[:1]:
                raise TableError(
                    f"row {i}: {self.name} is {numbers[i]:g}; expected {self.lower:g} plus "
                    f"a multiple of {self.spacing:g}"
                )
            return landed
        return numbers

    def encode(self, values: FloatArray) -> FloatArray:
        """(n, 1) columns of (n,) values."""
        low, high, v = self._scaled(self.lower), self._scaled(self.upper), self._scaled(values)
        return np.clip((v - low) / (high - low), 0.0, 1.0)[:, None]

    def decode(self, columns: FloatArray) -> FloatArray:
        """(n,) values of (n, 1) columns: a step where one lies on it up to rounding, else what was set."""
        values = self.between_steps(columns)
        if self.spacing is None:
            return values
        landed = self.land_values(values)
        return np.where(np.abs(landed - values) <= self._rounding, landed, values)

    def between_steps(self, columns: FloatArray) -> FloatArray:
        """(n,) values of (n, 1) columns, as if there were no steps."""
        low, high = self._scaled(self.lower), self._scaled(self.upper)
        scaled = low + np.clip(columns[:, 0], 0.0, 1.0) * (high - low)
        return np.asarray(np.clip(np.exp(scaled) if self.log else scaled, self.lower, self.upper))

    def land(self, columns: FloatArray) -> FloatArray:
        """(n, 1) nearest columns whose values can be set."""
        return columns if self.spacing is None else self.encode(self.land_values(self.between_steps(columns)))

    def land_values(self, values: FloatArray) -> FloatArray:
        """(n,) nearest values that can be set."""
        if self.spacing is None:
            return values
        steps = np.floor((self.upper - self.lower) / self.spacing + _ON_STEP)
        landed = self.lower + np.clip(np.round((values - self.lower) / self.spacing), 0, steps) * self.spacing
        whole = self._whole_digits - 1
        decimals = max(_DIGITS - whole, self._step_decimals)
        if whole + decimals < _FLOAT_DIGITS:  # beyond, rounding itself would lose digits
            landed = np.round(landed, decimals)  # 0.6, not 0.6000000000000001
        return np.asarray(np.minimum(landed, self.upper))

    def beside(self, value: float) -> list[float]:
        """The values one step away; none where every value can be set."""
        if self.spacing is None:
            return []
        around = self.land_values(
            np.clip([value - self.spacing, value + self.spacing], self.lower, self.upper)
        )
        return [float(v) for v in around if abs(v - value) > _ON_STEP * self.spacing]

    def python(self, value: Any) -> float | int | str | bool:
        """A decoded value as plain Python, with twelve digits: what was 6.88 in a table is 6.88 again.

        More where twelve would show another value than the one that was judged: in a narrow range far from 0,
        and on fine steps.
        """
        narrow = int(np.ceil(np.log10(self._largest) - np.log10(self.upper - self.lower))) - _SPARE
        fine = 0 if self.spacing is None else self._whole_digits + self._step_decimals - _DIGITS
        digits = min(_DIGITS + max(narrow, fine - 1, 0), _EXACT)
        return min(max(float(f"{float(value):.{digits}g}"), self.lower), self.upper)

    @property
    def _rounding(self) -> float:
        """How far from a step a value may lie that was on it before it went through the box."""
        assert self.spacing is not None
        ratio = math.log(self.upper / self.lower) if self.log else 1.0
        return max(_ON_STEP * self.spacing, _LOST * (1.0 + ratio) * self._largest)

    @property
    def _largest(self) -> float:
        """Largest size of a value."""
        return float(max(abs(self.lower), abs(self.upper)))

    @property
    def _whole_digits(self) -> int:
        """Digits before the decimal point of the largest value; 0 and less below 1."""
        return int(np.floor(np.log10(self._largest))) + 1

    @property
    def _step_decimals(self) -> int:
        """Digits behind the decimal point that a step such as 0.125 has."""
        assert self.spacing is not None
        return 2 - int(np.floor(np.log10(self.spacing)))

    def _scaled(self, value: Any) -> Any:
        return np.log(value) if self.log else np.asarray(value, float)


@dataclass(frozen=True)
class Integer(Real):
    """A whole number within a range."""

    kind: Literal["integer"] = field(default="integer", kw_only=True)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        super().__post_init__()
        what = f"parameter {self.name!r}"
        if self.step is not None and float(self.step) != int(self.step):
            raise DescriptionError(f"{what}: step is {self.step:g}; expected a whole number")
        for end, value in (("lower", self.lower), ("upper", self.upper)):
            if float(value) != int(value):
                raise DescriptionError(f"{what}: {end} is {value:g}; expected a whole number")

    @property
    def spacing(self) -> float:
        """Distance between values that can be set."""
        return 1.0 if self.step is None else self.step

    def python(self, value: Any) -> float | int | str | bool:
        """A decoded value as plain Python; a fraction that somebody set is no other number."""
        return int(value) if float(value).is_integer() else super().python(value)


@dataclass(frozen=True)
class Choice:
    """One of several values.

    Attributes:
        name: column name.
        values: texts, numbers or truth values, at least two, all different.
        ordered: neighbours in the list are more alike than others (sizes, stages); otherwise any two values
            are equally far apart.
        unit: is shown.
    """

    name: str
    values: tuple[str | int | float | bool, ...]
    ordered: bool = False
    unit: str = ""
    kind: Literal["choice"] = field(default="choice", kw_only=True)

    def __post_init__(self) -> None:
        check_name(self.name, "a parameter")
        what = f"parameter {self.name!r}"
        if isinstance(self.values, str) or not isinstance(self.values, Sequence | np.ndarray):
            raise DescriptionError(f"{what}: values are {self.values!r}; expected a list")
        object.__setattr__(self, "values", tuple(plain_value(v, what, "can be") for v in self.values))
        if len(self.values) < 2:
            raise DescriptionError(
                f"{what} has {len(self.values)} values; expected at least two (or a Fixed)"
            )
        check_distinct(map(str, self.values), f"values of {what}")
        numbers = [v for v in self.values if not isinstance(v, str | bool)]
        check_distinct(
            (f"{float(v) + 0.0!r}" for v in numbers), f"values of {what}"
        )  # 1 is 1.0 in tables, and -0.0 is 0.0

    @property
    def spacing(self) -> float:
        """Distance between values in their own numbering."""
        return 1.0

    @property
    def width(self) -> int:
        """Columns of the box: one when ordered or of two values, else one per value."""
        return 1 if self.ordered or len(self.values) == 2 else len(self.values)

    def check(self, values: Sequence[Any], *, exact: bool = False) -> FloatArray:
        """(n,) positions in `values`; TableError names a value that is not among them."""
        positions = {str(value): float(i) for i, value in enumerate(self.values)}
        found = []
        for i, value in enumerate(values):
            given = value.item() if isinstance(value, np.generic) else value
            if isinstance(given, float) and given.is_integer() and str(given) not in positions:
                given = int(given)  # a column of whole numbers with a gap is one of floats in pandas
            if str(given) not in positions:
                raise TableError(f"row {i}: {self.name} is {value!r}; expected one of {shown(self.values)}")
            found.append(positions[str(given)])
        return np.array(found)

    def encode(self, values: FloatArray) -> FloatArray:
        """(n, width) columns of (n,) positions."""
        if self.width == 1:
            return values[:, None] / (len(self.values) - 1)
        return (values[:, None] == np.arange(len(self.values))).astype(float)

    def decode(self, columns: FloatArray) -> FloatArray:
        """(n,) positions of (n, width) columns."""
        if self.width == 1:
            last = len(self.values) - 1
            return np.asarray(np.clip(np.round(columns[:, 0] * last), 0, last))
        return columns.argmax(axis=1).astype(float)

    def land(self, columns: FloatArray) -> FloatArray:
        """(n, width) nearest columns that stand for a value."""
        return self.encode(self.decode(columns))

    def beside(self, value: float) -> list[float]:
        """The positions one choice away: the neighbours of an ordered one, otherwise all others."""
        others = range(len(self.values))
        return [float(i) for i in others if (abs(i - value) == 1 if self.ordered else i != value)]

    def python(self, value: Any) -> float | int | str | bool:
        """The value at a position."""
        return self.values[int(value)]


@dataclass(frozen=True)
class Fixed:
    """A value that is recorded with every trial and never changes.

    Attributes:
        name: column name.
        value: a text, number or truth value.
        unit: is shown.
    """

    name: str
    value: str | int | float | bool
    unit: str = ""
    kind: Literal["fixed"] = field(default="fixed", kw_only=True)

    def __post_init__(self) -> None:
        check_name(self.name, "a parameter")
        object.__setattr__(self, "value", plain_value(self.value, f"parameter {self.name!r}", "is fixed at"))

    @property
    def width(self) -> int:
        """Columns of the box: none."""
        return 0

    def check(self, values: Sequence[Any], *, exact: bool = False) -> FloatArray:
        """(n,) zeros; TableError names a value that is not the fixed one."""
        for i, value in enumerate(values):
            same = value == self.value or str(value) == str(self.value)
            if not same:
                raise TableError(f"row {i}: {self.name} is {value!r}; expected the fixed {self.value!r}")
        return np.zeros(len(values))

    def encode(self, values: FloatArray) -> FloatArray:
        """(n, 0)."""
        return np.empty((len(values), 0))

    def decode(self, columns: FloatArray) -> FloatArray:
        """(n,) zeros."""
        return np.zeros(len(columns))

    def land(self, columns: FloatArray) -> FloatArray:
        """The same."""
        return columns

    def beside(self, value: float) -> list[float]:
        """None."""
        return []

    def python(self, value: Any) -> float | int | str | bool:
        """The fixed value."""
        return self.value


Parameter = Real | Integer | Choice | Fixed
