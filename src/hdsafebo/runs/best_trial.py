"""The best safe trial of a run file, to play it again and draw it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hdsafebo.errors import DatasetError
from hdsafebo.runs.read import read_run
from hdsafebo.typing import FloatArray


@dataclass(frozen=True)
class BestTrial:
    """A trial of a run file.

    Attributes:
        method: that proposed it.
        seed: of its run.
        trial: its number in that run.
        objective: as it was evaluated.
        z: (d,) what was searched, in the single precision of run files.
        latent: z is the code of an embedding; otherwise it is the problem's own input.
        mean_best: mean over runs of the best safe objective; the trial itself is the best of all runs.
    """

    method: str
    seed: int
    trial: int
    objective: float
    z: FloatArray
    latent: bool
    mean_best: float


def best_trial(path: Path) -> BestTrial | None:
    """The proposed trial of highest objective among the safe ones of all seeds; None when none was safe.

    Args:
        path: a run file.

    Raises:
        DatasetError: the file cannot be read as a run file.
    """
    run = read_run(path)
    proposed = run.chosen[run.chosen["safe"]]
    if proposed.empty:
        return None
    best = proposed.iloc[int(proposed["objective"].to_numpy().argmax())]
    safe = run.trials[run.trials["safe"] & (run.trials["status"] == "completed")]
    seed, trial = int(best["seed"]), int(best["trial"])
    return BestTrial(
        method=run.meta.method,
        seed=seed,
        trial=trial,
        objective=float(best["objective"]),
        z=_searched(path, seed, trial),
        latent=run.meta.space == "latent",
        mean_best=float(safe.groupby("seed")["objective"].max().mean()),
    )


def _searched(path: Path, seed: int, trial: int) -> FloatArray:
    """(d,) coordinates of one trial; `read_run` leaves the column out, because it is the bulk of the file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.ParquetFile(path).read(columns=["seed", "trial", "z"])
        rows = np.flatnonzero((table["seed"].to_numpy() == seed) & (table["trial"].to_numpy() == trial))
        return np.asarray(table["z"][int(rows[0])].as_py(), float)
    except (OSError, KeyError, pa.ArrowException) as error:
        raise DatasetError(f"{path}: column z cannot be read: {error}") from None
