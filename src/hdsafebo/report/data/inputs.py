"""What the report reads besides run files. A missing file is None; a malformed one is an error."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd
from pydantic import BaseModel, ConfigDict, ValidationError

from hdsafebo.errors import DatasetError
from hdsafebo.files.bounded import read_bytes
from hdsafebo.files.parquet import column_names, read_parquet
from hdsafebo.report.data.body_inputs import BodyInputs, read_body
from hdsafebo.report.data.hand_inputs import HandInputs, read_hand
from hdsafebo.report.data.json_files import read_json

M = TypeVar("M", bound=BaseModel)

ISOMETRY = "reports/isometry.json"
DISTANCES = "reports/isometry_pairs.parquet"
SYNERGIES = "models/synergies/pca.json"
LEARNING = "data/rollouts/learning_curve.parquet"
STIMULATION = "data/spinal/selectivity.json"
TRAVERSAL = "data/spinal/traversal.json"
HAND_FRAMES = "data/rollouts"
SPINAL_FRAMES = "data/spinal/figures"


class Isometry(BaseModel):
    """How well one embedding keeps distances and predictions."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    distance_correlation: float
    scale: float | None = None
    gp_mean_difference: float
    gp_variance_difference: float
    round_trip: float | None = None
    round_trip_held_out: float | None = None
    round_trip_held_out_currents: float | None = None
    reconstruction_mse: float | None = None
    condition_number: float | None = None


class TraversalCost(BaseModel):
    """Seconds and peak memory (MB) of the traversal."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    seconds: float
    peak_mb: float | None = None


class _Synergies(BaseModel):
    variance_accounted_for: list[float]


class Selectivity(BaseModel):
    """Counts of the parameters by the selectivity of one muscle, both sides of the body.

    Attributes:
        safe: counts between the edges.
        unsafe: the same of the unsafe ones.
        best_safe: largest selectivity of a safe one; None when none is safe.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    safe: list[int]
    unsafe: list[int]
    best_safe: float | None


class FieldMap(BaseModel):
    """An example of a field map: 52 rows of 14 pixels, and the name of its parameters."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    pixels: list[list[float]]
    title: str


class Stimulation(BaseModel):
    """The traversed stimulation parameters.

    Attributes:
        rows: number of parameters.
        threshold: of g for a safe one.
        safe_share: share of safe ones.
        edges: of the counts, increasing.
        selectivity: by muscle.
        example: the safe parameters that select the left ST best.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    rows: int
    threshold: float
    safe_share: float
    edges: list[float] = []
    selectivity: dict[str, Selectivity] = {}
    example: FieldMap | None = None


@dataclass(frozen=True)
class StoredPicture:
    """A PNG picture of another stage, shown as it is."""

    title: str
    data: bytes

    @property
    def is_wide(self) -> bool:
        """At least 1.4 times as wide as high (bytes 16 to 24 are the sizes: PNG specification, IHDR)."""
        width, height = struct.unpack(">II", self.data[16:24]) if len(self.data) >= 24 else (0, 1)
        return bool(width >= 1.4 * height)


@dataclass(frozen=True)
class StoredFilm:
    """A video (MP4) of another stage, shown as it is."""

    title: str
    data: bytes


@dataclass(frozen=True)
class Inputs:
    """Everything besides run files; what was not made is None or empty."""

    isometry: dict[str, Isometry] | None
    distances: dict[str, pd.DataFrame] | None
    variance: pd.DataFrame | None
    learning_curve: pd.DataFrame | None
    stimulation: Stimulation | None
    traversal: TraversalCost | None
    hand: HandInputs
    body: BodyInputs
    hand_frames: list[StoredPicture]
    spinal_frames: list[StoredPicture]


def read_isometry(root: Path) -> dict[str, Isometry] | None:
    """Isometry check by embedding."""
    path = root / ISOMETRY
    data = read_json(path)
    if data is None:
        return None
    if not isinstance(data, dict):
        raise DatasetError(f"{path}: expected one object per embedding, got {type(data).__name__}")
    return {name: _validated(path, Isometry, check) for name, check in data.items()}


def read_distances(root: Path) -> dict[str, pd.DataFrame] | None:
    """Sampled pairwise distances by embedding: columns `original` and `latent`."""
    path = root / DISTANCES
    if not path.exists():
        return None
    names = [name for name in column_names(path, DatasetError) if name != "original"]
    frame = _parquet(path, ["original", *names])
    assert frame is not None
    return {name: frame[["original", name]].set_axis(["original", "latent"], axis=1) for name in names}


def read_variance(root: Path) -> pd.DataFrame | None:
    """Variance accounted for by the first synergies: columns `components`, `variance_accounted_for`."""
    data = read_json(root / SYNERGIES)
    if data is None:
        return None
    shares = _validated(root / SYNERGIES, _Synergies, data).variance_accounted_for
    return pd.DataFrame({"components": range(1, len(shares) + 1), "variance_accounted_for": shares})


def read_learning_curve(root: Path) -> pd.DataFrame | None:
    """Training episodes: columns `setting`, `step`, `total_reward`."""
    return _parquet(root / LEARNING, ["setting", "step", "total_reward"])


def read_traversal(root: Path) -> TraversalCost | None:
    """What the traversal took."""
    data = read_json(root / TRAVERSAL)
    return None if data is None else _validated(root / TRAVERSAL, TraversalCost, data)


def read_stimulation(root: Path) -> Stimulation | None:
    """What the traversal found."""
    data = read_json(root / STIMULATION)
    return None if data is None else _validated(root / STIMULATION, Stimulation, data)


def read_frames(folder: Path) -> list[StoredPicture]:
    """Pictures of another stage in the order of their names."""
    return [
        StoredPicture(path.stem.replace("_", " "), read_bytes(path)) for path in sorted(folder.glob("*.png"))
    ]


def read_inputs(root: Path, runs: Path) -> Inputs:
    """Read everything that is there.

    Args:
        root: the project's directory.
        runs: folder of the run files.

    Raises:
        DatasetError: a file is there but malformed.
    """
    return Inputs(
        isometry=read_isometry(root),
        distances=read_distances(root),
        variance=read_variance(root),
        learning_curve=read_learning_curve(root),
        stimulation=read_stimulation(root),
        traversal=read_traversal(root),
        hand=read_hand(root, runs),
        body=read_body(root),
        hand_frames=read_frames(root / HAND_FRAMES),
        spinal_frames=read_frames(root / SPINAL_FRAMES),
    )


def _parquet(path: Path, columns: list[str]) -> pd.DataFrame | None:
    return read_parquet(path, str(path), DatasetError, columns).to_pandas() if path.exists() else None


def _validated(path: Path, model: type[M], data: Any) -> M:
    try:
        return model.model_validate(data)
    except ValidationError as error:
        fault = error.errors()[0]
        raise DatasetError(f"{path}: {'.'.join(map(str, fault['loc']))}: {fault['msg']}") from None
