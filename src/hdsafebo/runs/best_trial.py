"""The best safe trials of a run file, to play them again and draw them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hdsafebo.errors import DatasetError
from hdsafebo.files.bounded import require_regular
from hdsafebo.params import Space
from hdsafebo.runs.read import read_run
from hdsafebo.typing import FloatArray

SAFE_ENOUGH = 0.95
"""Share of safe trials from which a method counts as safe in the comparison of returns."""


@dataclass(frozen=True)
class BestTrial:
    """A trial of a run file.

    Attributes:
        method: that proposed it.
        seed: of its run.
        trial: its number in that run.
        objective: as it was evaluated.
        z: (d,) what was searched, in the single precision of run files.
        space: what z is a point of.
        mean_best: mean over runs of the best safe objective.
        safe_share: share of safe trials among those that the method proposed, of all runs.
    """

    method: str
    seed: int
    trial: int
    objective: float
    z: FloatArray
    space: Space
    mean_best: float
    safe_share: float

    @property
    def latent(self) -> bool:
        """Whether z is the code of an embedding; otherwise it is the problem's own input."""
        return self.space == "latent"

    @property
    def safe_enough(self) -> bool:
        """Whether its method counts as safe."""
        return self.safe_share >= SAFE_ENOUGH


def best_trial(path: Path) -> BestTrial | None:
    """The proposed trial of highest objective among the safe ones of all seeds; None when none was safe.

    Args:
        path: a run file.

    Raises:
        DatasetError: the file cannot be read as a run file.
    """
    return max(best_trials(path), key=lambda trial: trial.objective, default=None)


def best_trials(path: Path, *, initial: bool = False) -> list[BestTrial]:
    """Of every seed that has one, the safe trial of highest objective.

    Args:
        path: a run file.
        initial: among the initial trials; otherwise among those that the method proposed.

    Raises:
        DatasetError: the file cannot be read as a run file.
    """
    run = read_run(path)
    safe = run.trials[run.trials["safe"] & (run.trials["status"] == "completed")]
    if safe.empty:
        return []
    mean_best = float(safe.groupby("seed")["objective"].max().mean())
    safe_share = float(run.chosen["safe"].mean())
    among = safe[safe["initial"] == initial]
    rows = [
        of_seed.iloc[int(of_seed["objective"].to_numpy().argmax())] for _, of_seed in among.groupby("seed")
    ]
    points = _searched(path, [(int(row["seed"]), int(row["trial"])) for row in rows])
    return [
        BestTrial(
            run.meta.method,
            int(row["seed"]),
            int(row["trial"]),
            float(row["objective"]),
            z,
            run.meta.space,
            mean_best,
            safe_share,
        )
        for row, z in zip(rows, points, strict=True)
    ]


def _searched(path: Path, trials: list[tuple[int, int]]) -> list[FloatArray]:
    """(d,) coordinates of each trial; `read_run` leaves them out, because they are the bulk of the file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not trials:
        return []
    try:
        require_regular(path)
        table = pq.ParquetFile(path).read(columns=["seed", "trial", "z"])
        numbers = list(zip(table["seed"].to_pylist(), table["trial"].to_pylist(), strict=True))
        column = table["z"]
        return [np.asarray(column[numbers.index(one)].values, float) for one in trials]
    except (OSError, KeyError, pa.ArrowException) as error:
        raise DatasetError(f"{path}: column z cannot be read: {error}") from None
