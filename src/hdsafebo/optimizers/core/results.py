"""Checks of the results that an optimiser is told, before anything is changed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdsafebo.errors import TrialError
from hdsafebo.gp.surrogate import apply_transform
from hdsafebo.optimizers.core.numbers import as_columns, as_integers, as_numbers, check_same_labels
from hdsafebo.optimizers.core.proposal import encode
from hdsafebo.problem import Codec, Problem
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import FloatArray, IntArray

_SLACK = 1e-6
"""Inputs that differ by such a share of their size differ by rounding."""


@dataclass(frozen=True)
class CheckedResults:
    """Checked results of n trials: NaN where a trial failed, finite elsewhere."""

    objective: FloatArray
    safety: FloatArray
    status: NDArray[np.uint8]


def check_results(
    problem: Problem, n: int, objective: ArrayLike, safety: ArrayLike, status: ArrayLike | None
) -> CheckedResults:
    """Results of n trials as arrays.

    Args:
        problem: whose safety functions the columns are.
        n: number of trials.
        objective: (n,) values; ignored where the trial failed.
        safety: (n, m) values, or (n,) when the problem has one safety function; or a table (DataFrame,
            mapping) with one column for each safety function, by name.
        status: (n,) `Status.COMPLETED` or `Status.FAILED`, or one for all; None means completed.

    Raises:
        TrialError: a wrong shape, a value that is no finite number, a status that is no result, or a value
            that its safety function's transform does not keep on its side of the threshold.
    """
    names = [s.name for s in problem.safety]
    check_same_labels(objective=objective, safety=safety, status=status)
    y = as_numbers(objective, "objective")
    g = as_columns(safety, names, "safety")
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
    _check_transforms(problem, g[completed])
    return CheckedResults(np.where(completed, y, np.nan), np.where(completed[:, None], g, np.nan), states)


def check_points(name: str, points: ArrayLike, columns: int) -> FloatArray:
    """(n, columns) finite numbers.

    Raises:
        TrialError: another shape, or a value that is no finite number.
    """
    table = as_numbers(points, name)
    if table.ndim != 2 or table.shape[1] != columns:
        raise TrialError(f"{name} has shape {table.shape}; expected (n, {columns})")
    bad = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if len(bad):
        raise TrialError(
            f"{name} holds NaN or infinite values in rows {bad.tolist()[:10]}; expected finite numbers"
        )
    return table


def check_within(problem: Problem, points: FloatArray) -> None:
    """Raise `TrialError` that names row, column, value and limits of a point outside the problem's box."""
    lower, upper = problem.bounds
    slack = _SLACK * np.maximum(upper - lower, np.maximum(np.abs(lower), np.abs(upper)))
    for i, j in np.argwhere((points < lower - slack) | (points > upper + slack))[:1]:
        raise TrialError(
            f"x is {points[i, j]:.10g} in row {i}, column {j}; expected {lower[j]:.10g} to {upper[j]:.10g}, "
            f"the bounds of {problem.name!r}"
        )


def check_noise(problem: Problem, noise: ArrayLike | None, n: int) -> FloatArray:
    """(n, 1 + m) known standard deviations, NaN where unknown; None means that none is known.

    Raises:
        TrialError: another shape, or a value that is neither positive nor NaN.
    """
    columns = 1 + len(problem.safety)
    if noise is None:
        return np.full((n, columns), np.nan)
    table = as_numbers(noise, "noise")
    if table.shape != (n, columns):
        raise TrialError(
            f"noise has shape {table.shape}; expected ({n}, {columns}), of the objective and of each safety "
            "function"
        )
    bad = np.argwhere((table <= 0) | np.isinf(table))
    for i, j in bad[:1]:
        raise TrialError(
            f"noise is {table[i, j]:g} in row {i}, column {j}; expected a positive standard deviation, or NaN"
        )
    return table


def check_rows(problem: Problem, candidate: ArrayLike | None, points: FloatArray) -> IntArray:
    """(n,) rows of the problem's candidate set, -1 for inputs that are not in it; None means none is.

    Args:
        problem: whose candidates are meant.
        candidate: (n,) the rows.
        points: (n, D) inputs, which must be those of the rows.

    Raises:
        TrialError: another shape or type, a row that does not exist, or one with another input.
    """
    n = len(points)
    total = 0 if problem.candidates is None else len(problem.candidates)
    rows = np.full(n, -1) if candidate is None else as_integers(candidate, "candidate")
    if rows.shape != (n,) or not np.issubdtype(rows.dtype, np.integer):
        raise TrialError(
            f"candidate has shape {rows.shape} and type {rows.dtype}; expected ({n},) whole numbers"
        )
    if n and (rows.min() < -1 or rows.max() >= total):
        raise TrialError(f"candidate holds {rows.min()} to {rows.max()}; expected -1 to {total - 1}")
    rows = rows.astype(np.int64)
    known = np.flatnonzero(rows >= 0)
    if len(known):
        assert problem.candidates is not None, "without a set the only row is -1"
        chosen = np.setdiff1d(np.arange(points.shape[1]), problem.contexts)
        expected = problem.candidates.inputs(rows[known])[:, chosen]
        other = known[~same_points(points[known][:, chosen], expected)]
        if len(other):
            raise TrialError(
                f"inputs number {other.tolist()[:10]} differ from those of their candidate rows "
                f"{rows[other].tolist()[:10]}; expected the row's own input, or -1"
            )
    return rows


def same_points(a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
    """(n,) True where rows of two tables agree, up to what another computer makes of the same calculation."""
    if a.shape != b.shape:
        return np.zeros(len(a), bool)
    return np.asarray(np.isclose(a, b, rtol=1e-6, atol=1e-9).all(axis=1))


def _states(status: ArrayLike | None, n: int) -> NDArray[np.uint8]:
    if status is None:
        return np.full(n, Status.COMPLETED, np.uint8)
    try:
        given = np.broadcast_to(as_integers(status, "status"), (n,))
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


def _check_transforms(problem: Problem, safety: FloatArray) -> None:
    """A transformed value must be safe exactly where the value is, and finite."""
    for j, function in enumerate(problem.safety):
        if function.transform is None or not function.modelled:
            continue
        with np.errstate(all="ignore"):
            shown = apply_transform(function.transform, safety[:, j])
            threshold = apply_transform(function.transform, np.array([function.threshold]))[0]
        if shown.shape != (len(safety),):
            raise TrialError(
                f"transform of safety {function.name!r} gave shape {shown.shape} for {len(safety)} values"
            )
        kept = (shown >= threshold) == (safety[:, j] >= function.threshold)
        kept |= np.isclose(shown, threshold, rtol=1e-9, atol=0.0)  # rounding of values next to the threshold
        bad = np.flatnonzero(~np.isfinite(shown) | ~kept)
        if len(bad):
            raise TrialError(
                f"transform of safety {function.name!r} makes {shown[bad[0]]} of the value "
                f"{safety[bad[0], j]} and {threshold} of the threshold {function.threshold}; expected an "
                "increasing function, finite for every value that is told"
            )


def run_instead(problem: Problem, embedding: Codec | None, asked: Trials, x: ArrayLike) -> Trials:
    """Asked trials with the (n, D) inputs that were really run, their codes, and no row where they differ.

    Raises:
        TrialError: as `check_points`, or another number of inputs.
    """
    points = check_points("x", x, problem.bounds.shape[1])
    if len(points) != len(asked):
        raise TrialError(f"x has {len(points)} rows; expected {len(asked)}, one per trial")
    check_within(problem, points)
    other = (points != asked.x).any(axis=1)
    return replace(
        asked,
        x=points,
        z=np.where(other[:, None], encode(embedding, points), asked.z),
        candidate=np.where(other, -1, asked.candidate),
    )
