"""What a caller hands in, as arrays of numbers: columns by their names, and nothing guessed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdsafebo.errors import TrialError
from hdsafebo.problem import first_text
from hdsafebo.typing import FloatArray


def as_numbers(values: Any, name: str) -> FloatArray:
    """As floats, where that is no guess: text, dates, complex and masked values are refused.

    Tensors are taken with or without gradients, from any device.

    Raises:
        TrialError: the values are no array of numbers, or are a table whose columns have names.
    """
    if isinstance(values, Mapping) or _named(values):
        raise TrialError(
            f"{name} has the columns {_columns(values)}, whose order nothing tells; "
            f"expected an array, such as {name}.to_numpy() in the order of the problem"
        )
    try:
        given = np.asanyarray(_detached(values))
        if given.size and (given.dtype.kind not in "biufO" or np.ma.is_masked(given)):
            what = "masked values" if np.ma.is_masked(given) else f"type {given.dtype}"
            raise TrialError(f"{name} is not an array of numbers: it has {what}")
        # Columns of text that pandas hands over are of objects, and so is a list with None in it.
        if (text := first_text(given)) is not None:
            raise TrialError(f"{name} is not an array of numbers: it has the text {text!r}")
        return np.array(given, dtype=float)
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        raise TrialError(f"{name} is not an array of numbers: {error}") from None


def as_columns(values: Any, names: Sequence[str], name: str) -> FloatArray:
    """As floats; the columns of a table (DataFrame, mapping) in the order of `names`, whatever theirs is.

    Raises:
        TrialError: as `as_numbers`, or the columns of a table are not exactly those named.
    """
    if not (isinstance(values, Mapping) or _named(values)):
        return as_numbers(values, name)
    columns = _columns(values)
    if sorted(map(str, columns)) != sorted(names):
        raise TrialError(f"{name} has the columns {columns}; expected exactly {list(names)}, in any order")
    parts = [as_numbers(values[column], f"{name} {column!r}") for column in names]
    if len({part.shape for part in parts}) != 1:
        raise TrialError(
            f"{name} has columns of the shapes {[part.shape for part in parts]}; expected one value per trial"
        )
    return np.stack([part.reshape(-1) for part in parts], axis=1)


def as_integers(values: ArrayLike, name: str) -> NDArray[Any]:
    """As an array of whole numbers or of nothing.

    Raises:
        TrialError: other values.
    """
    try:
        given = np.asarray(_detached(values))
    except (ValueError, TypeError, RuntimeError):
        raise TrialError(f"{name} has rows of different lengths") from None
    if given.size and given.dtype.kind not in "iu":
        raise TrialError(f"{name} is {str(values)[:80]}, type {given.dtype}; expected whole numbers")
    return given


def check_same_labels(**tables: Any) -> None:
    """Refuse columns of one table whose rows are labelled differently: they were sorted apart.

    Raises:
        TrialError: two of the values have an index (as pandas' have), and the indices differ.
    """
    labelled = {name: values.index for name, values in tables.items() if _indexed(values)}
    for name, index in list(labelled.items())[1:]:
        first, expected = next(iter(labelled.items()))
        if len(index) == len(expected) and list(index) != list(expected):
            raise TrialError(
                f"rows of {name} are labelled {list(index)[:5]}, those of {first} {list(expected)[:5]}; "
                "expected the same order"
            )


def _named(values: Any) -> bool:
    """A table whose columns have names, other than their numbers in order."""
    columns = getattr(values, "columns", None)
    return columns is not None and list(columns) != list(range(len(columns)))


def _columns(values: Any) -> list[Any]:
    return list(values.keys() if isinstance(values, Mapping) else values.columns)


def _indexed(values: Any) -> bool:
    index = getattr(values, "index", None)
    return index is not None and not callable(index)


def _detached(values: Any) -> Any:
    """Tensors without their gradients, in main memory; a list of them as a list of arrays."""
    if isinstance(values, (list, tuple)):
        return [_detached(value) for value in values] if any(map(_has_gradient, values)) else values
    return values.detach().cpu() if hasattr(values, "detach") and hasattr(values, "cpu") else values


def _has_gradient(value: Any) -> bool:
    return hasattr(value, "detach") or (isinstance(value, (list, tuple)) and any(map(_has_gradient, value)))
