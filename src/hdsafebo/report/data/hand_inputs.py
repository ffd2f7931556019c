"""What the section on the hand reads besides the columns that all run files share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from pydantic import BaseModel, ConfigDict

from hdsafebo.errors import DatasetError
from hdsafebo.files.bounded import read_bytes
from hdsafebo.files.parquet import column_names, read_parquet
from hdsafebo.report.data.json_files import read_model

DIFFICULTY = "data/synergies/random_policies.json"
POLICIES = "data/policies"
TASKS = ("hand", "hand_informed")
_COLUMNS = ["seed", "trial", "initial", "objective", "safe", "status", "safety_no_drop", "safety_upright"]


class StoredDifficulty(BaseModel):
    """What random policies do (`hand.reference.Difficulty` explains the fields)."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    policies: int
    dropped: float
    upright: float
    safe: float
    landing_limit: float
    return_quantiles: list[float]
    zero_policy_tilt: float
    zero_policy_upright: bool


class Policy(BaseModel):
    """A policy that was played again.

    Attributes:
        method: that found it.
        seed: of the run.
        objective: its return when it was found.
        replayed: its return when it was played again from the run file, whose codes have single precision.
        tilt: mean tilt of the last 20 steps, rad.
        upright: the bottle ended upright and held by the hand.
        dropped: it fell.
        failure: why the simulation failed, or None.
        picture: file name of the strip of pictures, or None.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    method: str
    seed: int
    objective: float
    replayed: float | None
    tilt: float | None
    upright: bool
    dropped: bool
    failure: str | None
    picture: str | None


class Policies(BaseModel):
    """The policies that are shown, the times of their pictures (s), and what is missing to draw them."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    frames_at_s: list[float]
    missing: str | None
    policies: list[Policy]


@dataclass(frozen=True)
class HandInputs:
    """Everything on the hand; what was not made is None or empty.

    Attributes:
        difficulty: what random policies do.
        policies: those that were played again.
        strips: PNG pictures by file name.
        outcomes: by task and method, one row per trial: seed, trial, initial, objective, safe, status,
            safety_no_drop and safety_upright, each at least 0 where the bottle was held, or ended upright;
            None where a run file does not have them.
    """

    difficulty: StoredDifficulty | None
    policies: Policies | None
    strips: dict[str, bytes]
    outcomes: dict[tuple[str, str], pd.DataFrame | None]


def read_hand(root: Path, runs: Path) -> HandInputs:
    """Read everything that is there.

    Args:
        root: the project's directory.
        runs: folder of the run files.

    Raises:
        DatasetError: a file is there but malformed.
    """
    folder = root / POLICIES
    return HandInputs(
        difficulty=read_model(root / DIFFICULTY, StoredDifficulty),
        policies=read_model(folder / "policies.json", Policies),
        strips={path.name: read_bytes(path) for path in sorted(folder.glob("*.png"))},
        outcomes={
            _named(path): _outcomes(path) for task in TASKS for path in sorted(runs.glob(f"{task}-*.parquet"))
        },
    )


def _named(path: Path) -> tuple[str, str]:
    """Task and method of a run file."""
    task, method = path.stem.split("-", 1)
    return task, method


def _outcomes(path: Path) -> pd.DataFrame | None:
    if not set(_COLUMNS) <= set(column_names(path, DatasetError)):
        return None
    return read_parquet(path, str(path), DatasetError, _COLUMNS).to_pandas()
