"""The best safe trial of a run file, for what looks at it closer than the numbers do."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import DatasetError
from hdsafebo.runs.write import METADATA_KEY

_COLUMNS = ["seed", "trial", "initial", "objective", "safe", "status", "z"]


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
    z: NDArray[np.float64]
    latent: bool
    mean_best: float


def best_trial(path: Path) -> BestTrial | None:
    """The proposed trial of highest objective among the safe ones of all seeds; None when none was safe.

    Args:
        path: a run file.

    Raises:
        DatasetError: the file cannot be read as a run file.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.ParquetFile(path).read(columns=_COLUMNS)
        facts = json.loads((table.schema.metadata or {})[METADATA_KEY])
        method, space = str(facts["method"]), facts["space"]
    except (OSError, KeyError, ValueError, pa.ArrowException) as error:
        raise DatasetError(f"{path}: cannot be read as a run file: {error}") from None
    seeds, objective = (table[name].to_numpy() for name in ("seed", "objective"))
    safe = table["safe"].to_numpy() & (table["status"].to_numpy() == "completed")
    proposed = np.flatnonzero(safe & ~table["initial"].to_numpy())
    if len(proposed) == 0:
        return None
    row = int(proposed[objective[proposed].argmax()])
    best = [float(objective[safe & (seeds == seed)].max()) for seed in np.unique(seeds[safe])]
    z = np.asarray(table["z"][row].as_py(), float)
    seed, trial = int(seeds[row]), int(table["trial"][row].as_py())
    return BestTrial(method, seed, trial, float(objective[row]), z, space == "latent", float(np.mean(best)))
