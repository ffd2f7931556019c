"""Checks of single values, with the name of what they belong to in every message."""

from __future__ import annotations

import math
from collections.abc import Iterable
from numbers import Integral
from numbers import Real as RealNumber
from typing import Annotated

import numpy as np
from pydantic import Strict

from hdsafebo.errors import HdSafeBOError
from hdsafebo.system.errors import DescriptionError

Number = Annotated[float, Strict()]
"""A number of a description; `true` is none, nor is text such as "1_0", which Python reads as 10."""
_LONGEST = 64
_FORBIDDEN = set(",;\n\r\t\"'")


def finite(value: object, what: str, error: type[HdSafeBOError] = DescriptionError) -> float:
    """A finite number.

    Raises:
        HdSafeBOError: as `error`: it is none; truth values and texts are none either.
    """
    if isinstance(value, bool | np.bool_) or not isinstance(value, RealNumber):
        raise error(f"{what} is {value!r}; expected a number")
    try:
        number = float(value)
    except OverflowError:  # a whole number of more digits than any float has
        number = math.inf
    if not math.isfinite(number):
        raise error(f"{what} is {number}; expected a finite number")
    return number


def plain(value: object, what: str) -> float | int:
    """A finite number as Python's own, so that a description can be written: NumPy's float32 cannot.

    Raises:
        DescriptionError: it is none.
    """
    number = finite(value, what)
    return int(value) if isinstance(value, Integral) else number


def set_plain(part: object, what: str, *names: str) -> None:
    """Make the numbers of a frozen part of a description plain; None stays.

    Raises:
        DescriptionError: one is no finite number.
    """
    for name in names:
        value = getattr(part, name)
        if value is not None:
            object.__setattr__(part, name, plain(value, f"{what}: {name}"))


def plain_value(value: object, what: str, verb: str) -> str | int | float | bool:
    """A text, number or truth value as Python's own, so that a description can be written.

    Raises:
        DescriptionError: it is none of these, or a number that is not finite, which no file can hold.
    """
    own = value.item() if isinstance(value, np.generic) else value
    if isinstance(own, str | bool):
        return own
    if not isinstance(own, int | float):
        raise DescriptionError(f"{what} {verb} {value!r}; expected a text, a number or a truth value")
    return plain(own, f"{what}: value")


def check_name(name: object, what: str) -> None:
    """Raise `DescriptionError` unless `name` can head a column of a table."""
    if (
        not isinstance(name, str)
        or not 0 < len(name) <= _LONGEST
        or name != name.strip()
        or not name.isprintable()
        or _FORBIDDEN & set(name)
    ):
        raise DescriptionError(
            f"name of {what} is {name!r}; expected 1 to {_LONGEST} printable characters without commas, "
            "semicolons, quotes or space at its ends"
        )


def check_distinct(names: Iterable[str], what: str) -> None:
    """Raise `DescriptionError` when a name occurs twice."""
    names = list(names)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise DescriptionError(f"{what} share the names {', '.join(map(repr, twice))}; expected each once")


def shown(values: Iterable[object], most: int = 8) -> str:
    """The first of some values, for messages."""
    values = list(values)
    text = ", ".join(repr(v) for v in values[:most])
    return text if len(values) <= most else f"{text} and {len(values) - most} more"
