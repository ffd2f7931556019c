"""Tables in and out, by name: DataFrames, lists of records, and single records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hdsafebo.system.description import NOISE, System
from hdsafebo.system.errors import TableError
from hdsafebo.system.values import finite
from hdsafebo.trials import Status
from hdsafebo.typing import FloatArray

if TYPE_CHECKING:
    import pandas as pd

    Table = pd.DataFrame | Mapping[str, Any] | Sequence[Mapping[str, Any]]

STATUS = "status"
TRIAL = "trial"
_STATES = {"completed": Status.COMPLETED, "failed": Status.FAILED}


@dataclass(frozen=True)
class ToldResults:
    """Outcomes of n trials in the signs of the optimiser.

    Attributes:
        objective: (n,) to be maximised.
        safety: (n, m) one column per side of a limit.
        status: (n,) values of `Status`.
        noise: (n, 1 + m) known standard deviations, NaN where unknown.
    """

    objective: FloatArray
    safety: FloatArray
    status: np.ndarray
    noise: FloatArray


def columns_of(table: Table, what: str) -> dict[str, list[Any]]:
    """Columns by name, of equal length.

    Args:
        table: a DataFrame, a mapping from names to values or to lists, or a sequence of records.
        what: the table is, for messages.

    Raises:
        TableError: it is none of these, or its rows have different names.
    """
    if hasattr(table, "columns") and hasattr(table, "itertuples"):
        return by_name(((n, table.iloc[:, j].tolist()) for j, n in enumerate(table.columns)), what)  # type: ignore[union-attr]
    if isinstance(table, Mapping):
        lists = {
            n: isinstance(v, list | tuple) or (isinstance(v, np.ndarray) and v.ndim > 0)
            for n, v in table.items()
        }
        if lists and all(lists.values()):
            columns = {n: list(v) for n, v in by_name(table.items(), what).items()}
            if len({len(v) for v in columns.values()}) > 1:
                raise TableError(f"{what} has columns of lengths { {n: len(v) for n, v in columns.items()} }")
            return columns
        if any(lists.values()):
            mixed = sorted(n for n, is_list in lists.items() if is_list)
            raise TableError(f"{what} has lists under {', '.join(mixed)} and single values elsewhere")
        return {n: [v] for n, v in by_name(table.items(), what).items()}
    if isinstance(table, Sequence) and not isinstance(table, str | bytes):
        if not all(isinstance(row, Mapping) for row in table):
            raise TableError(f"{what} is a list of {type(table[0]).__name__}; expected records with names")
        names = list(table[0]) if table else []
        for i, row in enumerate(table):
            if set(row) != set(names):
                raise TableError(f"{what}, row {i}: names {sorted(row)}; expected {sorted(names)}")
        return by_name(((n, [row[n] for row in table]) for n in names), what)
    raise TableError(
        f"{what} is {type(table).__name__}; expected a DataFrame, a record or a list of records, "
        "whose names say which value is which"
    )


def by_name(pairs: Iterable[tuple[Any, Any]], what: str) -> dict[str, Any]:
    """Values by name.

    Raises:
        TableError: a name is given twice: nobody knows which value was meant.
    """
    named: dict[str, Any] = {}
    for name, value in pairs:
        if str(name) in named:
            raise TableError(f"{what} has {str(name)!r} twice")
        named[str(name)] = value
    return named


def require(
    columns: Mapping[str, Sequence[Any]], needed: Sequence[str], optional: Sequence[str], what: str
) -> None:
    """Raise `TableError` when a column is missing or unknown."""
    missing = [name for name in needed if name not in columns]
    if missing:
        raise TableError(
            f"{what} lacks {', '.join(map(repr, missing))}; it has {', '.join(columns) or 'nothing'}"
        )
    unknown = [name for name in columns if name not in needed and name not in optional]
    if unknown:
        more = f" and, if known, {', '.join(optional)}" if optional else ""
        raise TableError(
            f"{what} has {', '.join(map(repr, unknown))}; expected {', '.join(needed) or 'none'}{more}"
        )


def result_names(system: System) -> list[str]:
    """Columns of results that may be there."""
    return [*system.outcomes, *(name + NOISE for name in system.outcomes), STATUS]


def measured(system: System, columns: Mapping[str, Sequence[Any]], n: int) -> ToldResults:
    """Outcomes of n trials from the columns of a table.

    Args:
        system: what is measured.
        columns: outcomes, `<outcome>_noise` and `status` ("completed" or "failed"; completed without it).
        n: number of trials.

    Raises:
        TableError: an outcome is missing, or no finite number although the trial completed.
    """
    status = _states(columns.get(STATUS), n)
    done = status == Status.COMPLETED
    values: dict[str, FloatArray] = {}
    noise: dict[str, FloatArray] = {}
    for name in system.outcomes:
        given = columns.get(name)
        if given is None and done.any():
            raise TableError(
                f"results lack {name!r}; expected {', '.join(system.outcomes)} "
                "(a trial without a result is told as failed)"
            )
        values[name] = np.full(n, np.nan)
        for i in np.flatnonzero(done):
            assert given is not None
            what = f"row {i}: {name}"
            try:
                values[name][i] = finite(given[int(i)], what, TableError)
            except TableError as error:
                raise TableError(f"{error} (a trial without a result is told as failed)") from None
        noise[name] = _noise(name, columns.get(name + NOISE), n)
    objective = system.objective
    sides = [(limit.name, sign) for limit in system.limits for sign, _ in limit.sides]
    return ToldResults(
        objective.sign * values[objective.name],
        np.column_stack([sign * values[name] for name, sign in sides]),
        status,
        np.column_stack([noise[objective.name], *(noise[name] for name, _ in sides)]),
    )


def _states(given: Sequence[Any] | None, n: int) -> np.ndarray:
    if given is None:
        return np.full(n, np.uint8(Status.COMPLETED))
    states = []
    for i, state in enumerate(given):
        if not isinstance(state, str) or state not in _STATES:
            raise TableError(f"row {i}: status is {state!r}; expected 'completed' or 'failed'")
        states.append(np.uint8(_STATES[state]))
    return np.array(states, np.uint8)


def _noise(name: str, given: Sequence[Any] | None, n: int) -> FloatArray:
    """(n,) known standard deviations; a missing value is unknown."""
    noise = np.full(n, np.nan)
    for i, value in enumerate(given or ()):
        if value is None or (isinstance(value, float | np.floating) and np.isnan(value)):
            continue
        noise[i] = finite(value, f"row {i}: {name}{NOISE}", TableError)
        if noise[i] <= 0:
            raise TableError(f"row {i}: {name}{NOISE} is {value!r}; expected a positive standard deviation")
    return noise
