"""Checks of the results that an optimiser is told, before anything is changed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdsafebo.errors import TrialError
from hdsafebo.problem import Problem
from hdsafebo.trials import Status
from hdsafebo.typing import FloatArray, IntArray


@dataclass(frozen=True)
class Results:
    """Checked results of n trials: NaN where a trial failed, finite elsewhere."""

    objective: FloatArray
    safety: FloatArray
    status: NDArray[np.uint8]


def check_results(
    problem: Problem, n: int, objective: ArrayLike, safety: ArrayLike, status: ArrayLike | None
) -> Results:
    """Results of n trials as arrays.

    Args:
        problem: whose safety functions the columns are.
        n: number of trials.
        objective: (n,) values; ignored where the trial failed.
        safety: (n, m) values, or (n,) when the problem has one safety function.
        status: (n,) `Status.COMPLETED` or `Status.FAILED`, or one for all; None means completed.

    Raises:
        TrialError: a wrong shape, a value that is no finite number, or a status that is no result.
    """
    names = [s.name for s in problem.safety]
    y = _numbers(objective, "objective")
    g = _numbers(safety, "safety")
    if g.ndim <= 1 and len(names) == 1:
        g = g.reshape(-1, 1)
    if y.ndim == 0:
        y = y.reshape(1)
    if y.shape != (n,):
        raise TrialError(f"objective has shape {y.shape}; expected ({n},), one value per trial")
    if g.shape != (n, len(names)):
        raise TrialError(
            f"safety has shape {g.shape}; expected ({n}, {len(names)}), one column for each of {names}"
        )
    states = _states(status, n)
    completed = states == Status.COMPLETED
    _check_finite("objective", y, completed)
    for j, name in enumerate(names):
        _check_finite(f"safety {name!r}", g[:, j], completed)
    return Results(np.where(completed, y, np.nan), np.where(completed[:, None], g, np.nan), states)


def check_points(name: str, points: ArrayLike, columns: int) -> FloatArray:
    """(n, columns) finite numbers.

    Raises:
        TrialError: another shape, or a value that is no finite number.
    """
    table = _numbers(points, name)
    if table.ndim != 2 or table.shape[1] != columns:
        raise TrialError(f"{name} has shape {table.shape}; expected (n, {columns})")
    bad = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if len(bad):
        raise TrialError(
            f"{name} holds NaN or infinite values in rows {bad.tolist()[:10]}; expected finite numbers"
        )
    return table


def check_rows(problem: Problem, candidate: ArrayLike | None, n: int) -> IntArray:
    """(n,) rows of the problem's candidate set, -1 for inputs that are not in it; None means none is.

    Raises:
        TrialError: another shape or type, or a row that does not exist.
    """
    total = 0 if problem.candidates is None else len(problem.candidates)
    rows = np.full(n, -1) if candidate is None else _integers(candidate, "candidate")
    if rows.shape != (n,) or not np.issubdtype(rows.dtype, np.integer):
        raise TrialError(
            f"candidate has shape {rows.shape} and type {rows.dtype}; expected ({n},) whole numbers"
        )
    if n and (rows.min() < -1 or rows.max() >= total):
        raise TrialError(f"candidate holds {rows.min()} to {rows.max()}; expected -1 to {total - 1}")
    return rows.astype(np.int64)


def _numbers(values: ArrayLike, name: str) -> FloatArray:
    """As floats, where that is no guess: text, dates, complex and masked values are refused."""
    try:
        given = np.asanyarray(values)
        if given.size and (given.dtype.kind not in "biufO" or np.ma.is_masked(given)):
            what = "masked values" if np.ma.is_masked(given) else f"type {given.dtype}"
            raise TrialError(f"{name} is not an array of numbers: it has {what}")
        return np.array(given, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise TrialError(f"{name} is not an array of numbers: {error}") from None


def _integers(values: ArrayLike, name: str) -> NDArray:
    """As an array of whole numbers or of nothing."""
    try:
        given = np.asarray(values)
    except ValueError:
        raise TrialError(f"{name} has rows of different lengths") from None
    if given.size and given.dtype.kind not in "iu":
        raise TrialError(f"{name} is {str(values)[:80]}, type {given.dtype}; expected whole numbers")
    return given


def _states(status: ArrayLike | None, n: int) -> NDArray[np.uint8]:
    if status is None:
        return np.full(n, Status.COMPLETED, np.uint8)
    try:
        given = np.broadcast_to(_integers(status, "status"), (n,))
    except ValueError:
        raise TrialError(f"status has shape {np.shape(status)}; expected ({n},)") from None
    if not np.isin(given, [Status.COMPLETED, Status.FAILED]).all():
        raise TrialError(
            f"status is {given.tolist()[:10]}; expected {Status.COMPLETED.value} (completed) "
            f"or {Status.FAILED.value} (failed)"
        )
    return given.astype(np.uint8)


def _check_finite(name: str, values: FloatArray, completed: NDArray[np.bool_]) -> None:
    bad = np.flatnonzero(completed & ~np.isfinite(values))
    if len(bad):
        raise TrialError(
            f"{name} is {values[bad[0]]} for trial number {bad[0]} of those told; expected a finite number "
            f"(report an evaluation that gave no result with status={Status.FAILED.value})"
        )
