"""What a run file holds: its columns, and what it says about itself.

A run file is `data/runs/<task>-<method>.parquet`, one row per trial of every seed. `write` and `read` know
the form of a run file from this module alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from hdsafebo.params import Space
from hdsafebo.problem import Problem
from hdsafebo.trials import Status

if TYPE_CHECKING:
    import pyarrow as pa

Rows = dict[str, NDArray[Any]]
"""Columns of a run file (k,) by name, and `z` (k, d) float32."""

METADATA_KEY = b"hdsafebo"
TIMES = ("method_seconds", "evaluate_seconds")
STATUS_NAMES = {Status.COMPLETED: "completed", Status.FAILED: "failed"}
COLUMNS = {
    "seed": "int32",
    "trial": "int32",
    "round": "int32",
    "initial": "bool",
    "objective": "float64",
    "safety": "float64",
    "safe": "bool",
    "violation": "float64",
    "modelled_violation": "float64",
    "predicted_safe_probability": "float64",
    "violation_bound": "float64",
    "trust_region_length": "float64",
    "method_seconds": "float64",
    "evaluate_seconds": "float64",
    "status": "str",
    "marked_unsafe": "bool",
    "repeated": "bool",
    "candidate": "int64",
}
"""Columns that every run file has, beside `z`; further safety functions have a float64 column each.

`violation` is of the functions that decide what was safe, in their units; `modelled_violation` of those that
a model was fitted to, as it was fitted to them, so that `violation_bound` speaks of the same. A trial is
`repeated` when its point was tried before in the same run. Times are CPU times of the process of the run, in
seconds.
"""


class Counts(BaseModel):
    """What went wrong in a run without ending it; sums where runs are pooled.

    Attributes:
        fits: Gaussian processes that rounds were asked with, of all functions together.
        jitters: fits that needed a larger diagonal than the noise.
        fallbacks: fits that failed, so that the last good hyper-parameters were kept.
        marked: trials that were not believed safe, and marked as such.
        missing: trials of the budget that were not made because the method abstained.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    fits: int
    jitters: int
    fallbacks: int
    marked: int
    missing: int

    @classmethod
    def total(cls, parts: Iterable[Counts]) -> Counts:
        """Sums over several runs."""
        every = list(parts)
        return Counts(**{name: sum(getattr(c, name) for c in every) for name in Counts.model_fields})


class RunCounts(Counts):
    """The counts of the run of one seed.

    Attributes:
        abstained: why the method ended before the trials were used up; None if it did not.
        certified: points of the method's own discretisation that it certified, at most in any round; None for
            methods that certify none.
    """

    abstained: str | None
    certified: int | None = None


class RunMetadata(BaseModel):
    """What a run file says about itself.

    Attributes:
        task: name of the task.
        method: name of the method's block in the parameters.
        algorithm: what runs under that name, by its name in the registry of methods.
        profile: name of the sizes it was run with.
        settings: the method's settings.
        safety_names: safety functions in the order of the problem.
        thresholds: one per safety function.
        beta: scalar of the confidence bound mu + beta * sigma of the safe set; None without one.
        guaranteed_alpha: safe probability per trial that this beta guarantees, 1 - Phi(beta).
        optimum: best safe objective when it is known and the same for all seeds.
        n_initial: trials before the optimiser starts.
        batch: trials per round.
        n_trials: all trials of a run, the initial ones included.
        seeds: one per run.
        counts: one per run, in the same order.
        space: what was searched, the codes of an embedding or the problem's own inputs.
        dimension: number of searched coordinates.
        given: what the task gave to its methods, by name, see `problems.knowledge`.
        unused: names of what was given and the method does not use.
        code: digest of the modules that computed the trials (`campaign.run_spec.code_digest`); None in
            files of versions that did not write it.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    task: str
    method: str
    algorithm: str
    profile: str
    settings: dict[str, Any]
    safety_names: list[str]
    thresholds: list[float]
    beta: float | None
    guaranteed_alpha: float | None
    optimum: float | None
    n_initial: int
    batch: int
    n_trials: int
    seeds: list[int]
    counts: list[RunCounts]
    space: Space
    dimension: int
    given: dict[str, str] = {}
    unused: list[str] = []
    code: str | None = None


def run_name(task: str, method: str) -> str:
    """Name of a run file, without its suffix."""
    return f"{task}-{method}"


def safety_columns(problem: Problem) -> list[str]:
    """Column names of the problem's safety functions: `safety` for the first that is reported."""
    first = next(j for j, s in enumerate(problem.safety) if s.reported)
    return ["safety" if j == first else f"safety_{s.name}" for j, s in enumerate(problem.safety)]


def arrow_type(column: str) -> pa.DataType:
    """The type of a column in the file; z is a list of float32."""
    import pyarrow as pa

    if column == "z":
        return pa.list_(pa.float32())
    name = COLUMNS.get(column, "float64")
    return pa.string() if name == "str" else pa.from_numpy_dtype(np.dtype(name))
