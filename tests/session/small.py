"""Small sessions: a box, a list, and a stimulation session with bipolar configurations only."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import write_mapping
from hdsafebo.session.log.state import LoggedSuggestion, LoggedTrial
from hdsafebo.session.patient.month import example_definition
from hdsafebo.session.session import Session
from hdsafebo.session.spaces.space import Report

CURRENTS_MA = [0.05, 0.1, 0.2, 0.3, 0.4]


def bowl(values: Sequence[float]) -> dict[str, float]:
    """A smooth problem in three inputs; safe near the middle, the best speed lies off it."""
    a, b, c = values
    return {
        "speed": 1.0 - (a - 0.7) ** 2 - (b - 0.4) ** 2 - (c - 0.3) ** 2,
        "economy": -a,
        "margin": 0.2 - (a - 0.5) ** 2 - (b - 0.5) ** 2 - 0.3 * c**2,
    }


def box_definition(kind: str = "box") -> dict[str, Any]:
    """A session file of a generic kind."""
    return {
        "kind": kind,
        "name": "bench",
        "seed": 3,
        "target": "speed",
        "inputs": [
            {"name": "a", "lower": 0.0, "upper": 1.0, "max_step": 0.3, "home": 0.5},
            {"name": "b", "lower": 0.0, "upper": 1.0, "max_step": 0.3, "home": 0.5},
            {"name": "c", "lower": -1.0, "upper": 1.0, "max_step": 0.6, "home": 0.0},
        ],
        "outcomes": ["speed", "economy"],
        "safety": [{"name": "margin", "threshold": 0.0}],
    } | ({"candidates": "candidates.csv"} if kind == "list" else {})


def write_box_files(folder: Path, kind: str = "box", n: int = 8) -> tuple[Path, Path]:
    """Session file and initial trials (and candidates) of a generic session."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    definition, initial = folder / "session.yaml", folder / "initial.csv"
    write_mapping(definition, box_definition(kind), ParamsError)
    points = rng.uniform([0.4, 0.4, -0.2], [0.6, 0.6, 0.2], (n, 3)).round(6).tolist()
    if kind == "list":
        grid = [[a / 10, b / 10, c / 5] for a in range(11) for b in range(11) for c in range(-5, 6)]
        points = [
            grid[i] for i in rng.choice(len(grid), 200, replace=False) if bowl(grid[i])["margin"] > 0.1
        ][:n]
        (folder / "candidates.csv").write_text(
            "a,b,c\n" + "".join(",".join(map(repr, p)) + "\n" for p in grid)
        )
    rows = [[*p, *bowl(p).values()] for p in points]
    initial.write_text("a,b,c,speed,economy,margin\n" + "".join(",".join(map(repr, r)) + "\n" for r in rows))
    return definition, initial


def measured(trial: LoggedTrial) -> Report:
    """What the bowl gives for a trial."""
    return Report(values=bowl(trial.point["values"]))


def approve_open(session: Session) -> LoggedTrial:
    """Approve the open suggestion."""
    return session.approve("ann", session.state.suggestions[-1].number)


def refuse_open(session: Session, reason: str) -> LoggedSuggestion:
    """Refuse the open suggestion."""
    return session.refuse("ann", reason, session.state.suggestions[-1].number)


class FakeClock:
    """A clock that advances by a minute per look."""

    def __init__(self) -> None:
        self.now = datetime(2026, 3, 2, 9, 0, tzinfo=UTC)

    def __call__(self) -> datetime:
        self.now += timedelta(minutes=1)
        return self.now


def small_definition(seed: int = 1) -> dict[str, Any]:
    """The simulated patient's session file, with bipolar configurations only."""
    data = example_definition(CURRENTS_MA, seed)
    data["priors"]["poles"] = [{"cathodes": 1, "anodes": [1]}]
    return data
