"""What the section on the whole body reads besides run files: its best policies, played again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from hdsafebo.files.bounded import read_bytes
from hdsafebo.report.data.json_files import read_model

POLICIES = "data/body/policies"
FILM = "best_beside_reflex.mp4"
REFLEX = "reflex"
"""Name under which the best initial policy of a seed stands among methods."""


class StoredOutcome(BaseModel):
    """What a policy did after some pushes (`problems.body_replay.Outcome` explains the fields)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    seconds: list[float]
    loads: list[float]
    total: float
    failure: str | None


class BodyPolicy(BaseModel):
    """A policy that was played again.

    Attributes:
        method: that proposed it, or `reflex`.
        seed: of the run.
        trial: its number in the run.
        objective: its return when it was found.
        known: after the pushes that every trial meets.
        unseen: after pushes that no trial met, if there are any.
        picture: file name of the strip of pictures, or None.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    method: str
    seed: int
    trial: int
    objective: float
    known: StoredOutcome
    unseen: StoredOutcome | None
    picture: str | None


class BodyPolicies(BaseModel):
    """All policies that were played again, for how long at most (s), and what is missing to draw them."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    horizon_s: float
    pushes: list[int]
    unseen_pushes: list[int]
    missing: str | None
    policies: list[BodyPolicy]


@dataclass(frozen=True)
class BodyInputs:
    """Everything on the body; what was not made is None or empty.

    Attributes:
        played: the policies that were played again.
        strips: PNG pictures by file name.
        film: MP4 of the best policy, and beside it of the best reflex of its seed.
    """

    played: BodyPolicies | None
    strips: dict[str, bytes]
    film: bytes | None


def read_body(root: Path) -> BodyInputs:
    """Read everything that is there.

    Args:
        root: the project's directory.

    Raises:
        DatasetError: a file is there but malformed.
    """
    folder = root / POLICIES
    film = folder / FILM
    return BodyInputs(
        played=read_model(folder / "policies.json", BodyPolicies),
        strips={path.name: read_bytes(path) for path in sorted(folder.glob("*.png"))},
        film=read_bytes(film) if film.exists() else None,
    )
