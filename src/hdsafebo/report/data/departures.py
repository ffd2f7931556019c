"""The list of differences from the paper, kept as data in `departures.yaml` beside this package."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from hdsafebo.errors import DatasetError
from hdsafebo.files.yaml import read_mapping

FILE = "departures.yaml"


class Departure(BaseModel):
    """One difference.

    Attributes:
        where: what it concerns.
        paper: what the paper has, or that it leaves this open.
        here: what this project has.
        changes: what follows for the numbers.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    where: str = Field(min_length=1)
    paper: str = Field(min_length=1)
    here: str = Field(min_length=1)
    changes: str = Field(min_length=1)


class Departures(BaseModel):
    """All of them, in the order in which they are shown."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    departures: list[Departure]


def read_departures() -> list[Departure]:
    """The list that belongs to this version of the package."""
    path = Path(str(files("hdsafebo.report") / FILE))
    return Departures.model_validate(read_mapping(path, DatasetError)).departures
