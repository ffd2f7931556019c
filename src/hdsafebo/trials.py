"""The table of trials, and the results that fill it in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import TrialError
from hdsafebo.typing import FloatArray, IntArray

_SHOWN, _COLUMNS = 8, 6
"""Trials and columns of the input that the text of a table shows."""


class Status(IntEnum):
    """State of a trial; a failed evaluation is a status, never a number."""

    PENDING = 0
    COMPLETED = 1
    FAILED = 2


@dataclass(frozen=True)
class Evaluation:
    """Results of n evaluations.

    Attributes:
        objective: (n,) values to maximise; ignored where `failed`.
        safety: (n, m) one column per safety function of the problem; ignored where `failed`.
        failed: (n,) True where the evaluation gave no result; None means that all succeeded.
        reasons: n reasons why an evaluation gave no result, None where it gave one; None means that the
            problem gives no reasons.
    """

    objective: FloatArray
    safety: FloatArray
    failed: NDArray[np.bool_] | None = None
    reasons: tuple[str | None, ...] | None = None

    def status(self) -> NDArray[np.uint8]:
        """(n,) `Status.COMPLETED` or `Status.FAILED`."""
        failed = np.zeros(len(self.objective), bool) if self.failed is None else np.asarray(self.failed, bool)
        return np.where(failed, np.uint8(Status.FAILED), np.uint8(Status.COMPLETED))


@dataclass(frozen=True)
class Trial:
    """One trial: a row of `Trials`, numbers instead of columns."""

    id: int
    x: FloatArray
    z: FloatArray
    candidate: int
    objective: float
    safety: FloatArray
    status: Status
    initial: bool
    round: int
    predicted_safe_probability: float
    violation_bound: float
    trust_region_length: float
    marked_unsafe: bool
    noise: FloatArray


@dataclass(frozen=True, repr=False)
class Trials:
    """A table of n trials, one array per column.

    Attributes:
        id: (n,) number of the trial within its optimiser, from 0.
        x: (n, D) inputs of the problem.
        z: (n, d) the same points in the space that is searched (the embedding's codes).
        candidate: (n,) row of the problem's finite candidate set, -1 without one.
        objective: (n,) NaN unless completed.
        safety: (n, m) NaN unless completed.
        status: (n,) values of `Status`.
        initial: (n,) True for data that was there before the first `ask`.
        round: (n,) 0 for initial data, then 1, 2, ... per `ask`.
        predicted_safe_probability: (n,) Pr(all modelled safety functions are met), believed when the
            trial was asked; NaN where no model was consulted.
        violation_bound: (n,) bound on the expected violation believed when asked (see `safe_set`).
        trust_region_length: (n,) of the trust region the trial came from; NaN without one.
        marked_unsafe: (n,) True where no candidate was believed safe and the caller chose to be given
            the most probably safe one all the same.
        noise: (n, 1 + m) known standard deviations of the measured objective and safety values, NaN where the
            problem's own hold.
    """

    id: IntArray
    x: FloatArray
    z: FloatArray
    candidate: IntArray
    objective: FloatArray
    safety: FloatArray
    status: NDArray[np.uint8]
    initial: NDArray[np.bool_]
    round: IntArray
    predicted_safe_probability: FloatArray
    violation_bound: FloatArray
    trust_region_length: FloatArray
    marked_unsafe: NDArray[np.bool_]
    noise: FloatArray

    def __repr__(self) -> str:
        """The last trials as a short table."""
        shown = self[-_SHOWN:]
        lines = [f"Trials: {len(self)}, {int(self.completed.sum())} completed"]
        if len(shown) < len(self):
            lines[0] += f"; the last {len(shown)}:"
        for i in range(len(shown)):
            values = ", ".join(f"{v:.4g}" for v in shown.x[i][:_COLUMNS]) + (
                ", ..." if shown.x.shape[1] > _COLUMNS else ""
            )
            result = f"{Status(shown.status[i]).name.lower()}"
            if shown.completed[i]:
                safety = ", ".join(f"{v:.4g}" for v in shown.safety[i])
                result = f"objective {shown.objective[i]:.5g}, safety {safety}"
            probability = shown.predicted_safe_probability[i]
            believed = "" if np.isnan(probability) else f", believed safe with {probability:.3f}"
            marked = ", MARKED UNSAFE" if shown.marked_unsafe[i] else ""
            lines.append(f"  {shown.id[i]}: x = [{values}] {result}{believed}{marked}")
        return "\n".join(lines)

    def __len__(self) -> int:
        return len(self.id)

    def __getitem__(self, rows: NDArray[np.bool_] | IntArray | slice | Sequence[int]) -> Trials:
        """The sub-table of the given rows (a mask, a slice or row numbers)."""
        columns = {f.name: getattr(self, f.name)[rows] for f in fields(self) if f.name != "z"}
        return Trials(**columns, z=columns["x"] if self.z is self.x else self.z[rows])

    def one(self, row: int) -> Trial:
        """The trial of a row."""
        values = {f.name: getattr(self, f.name)[row] for f in fields(self)}
        plain = {name: value.item() for name, value in values.items() if value.ndim == 0}
        return Trial(**(values | plain | {"status": Status(int(values["status"]))}))

    def append(self, other: Trials) -> Trials:
        """This table followed by `other`; both have the same D, d and m."""
        return Trials(
            **{f.name: np.concatenate([getattr(self, f.name), getattr(other, f.name)]) for f in fields(self)}
        )

    def with_results(self, evaluation: Evaluation) -> Trials:
        """The same trials with objective, safety and status filled in."""
        status = evaluation.status()
        done = status == Status.COMPLETED
        return replace(
            self,
            objective=np.where(done, evaluation.objective, np.nan),
            safety=np.where(done[:, None], evaluation.safety, np.nan),
            status=status,
        )

    @property
    def completed(self) -> NDArray[np.bool_]:
        """(n,) True where objective and safety are known."""
        return self.status == Status.COMPLETED

    @classmethod
    def pending(
        cls,
        x: FloatArray,
        z: FloatArray,
        n_safety: int,
        *,
        first_id: int = 0,
        round: int = 0,
        **columns: object,
    ) -> Trials:
        """n trials without results; `columns` overrides any of the other columns."""
        n = len(x)
        table: dict[str, object] = {
            "id": np.arange(first_id, first_id + n),
            "x": np.asarray(x, float),
            "z": np.asarray(z, float),
            "candidate": np.full(n, -1),
            "objective": np.full(n, np.nan),
            "safety": np.full((n, n_safety), np.nan),
            "status": np.full(n, Status.PENDING, np.uint8),
            "initial": np.zeros(n, bool),
            "round": np.full(n, round),
            "predicted_safe_probability": np.full(n, np.nan),
            "violation_bound": np.full(n, np.nan),
            "trust_region_length": np.full(n, np.nan),
            "marked_unsafe": np.zeros(n, bool),
            "noise": np.full((n, 1 + n_safety), np.nan),
        }
        unknown = set(columns) - set(table)
        if unknown:
            raise TrialError(f"unknown trial columns {sorted(unknown)}; expected some of {sorted(table)}")
        return cls(**(table | columns))  # type: ignore[arg-type]
