"""What a stimulation does in the spinal model: the traversal's table, by configuration and current."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hdsafebo.errors import DatasetError
from hdsafebo.files.bounded import require_regular
from hdsafebo.session.log.state import Point
from hdsafebo.session.measuring.stimulator import CONTACTS, Polarity
from hdsafebo.session.spaces.stimulation import CURRENT_COLUMN
from hdsafebo.typing import FloatArray

# the clinical muscle groups of the paper and the model's that stand for them
MODEL_GROUPS = {"IL": "IL", "RF": "VL&RF", "TA": "TA", "BF": "BF&GM"}
SIDES = ("left", "right")
MUSCLES = tuple(f"{muscle}_{side}" for side in SIDES for muscle in MODEL_GROUPS)


@dataclass(frozen=True)
class Responses:
    """Activation of the model's muscles.

    Attributes:
        index: configuration -> row.
        currents_ma: (K,) currents, increasing.
        mu: (configurations, K, 8) activation of `MUSCLES`.
        strongest: (configurations, K) activation of the most activated of all muscles of the model.
    """

    index: dict[tuple[int, ...], int]
    currents_ma: FloatArray
    mu: FloatArray
    strongest: FloatArray

    def at(self, point: Point) -> tuple[FloatArray, float]:
        """mu (8,) of a stimulation and that of the most activated muscle, linear in the log of the current.

        Below the lowest current the response falls in proportion to the current.

        Raises:
            DatasetError: the configuration is not in the table.
        """
        mu, strongest = self.table(np.array([point["polarity"]]), np.array([float(point[CURRENT_COLUMN])]))
        return mu[0, 0], float(strongest[0, 0])

    def table(self, polarity: Polarity, current_ma: FloatArray) -> tuple[FloatArray, FloatArray]:
        """mu (n, K, 8) and the most activated muscle's (n, K) of configurations (n, 16) at K currents each.

        Raises:
            DatasetError: a configuration is not in the table.
        """
        try:
            rows = np.array([self.index[tuple(row)] for row in polarity.tolist()])
        except KeyError:
            raise DatasetError(
                "the simulated patient knows no such configuration; expected one of the model's table"
            ) from None
        weak = np.minimum(1.0, current_ma / self.currents_ma[0])
        level = np.interp(np.log(current_ma), np.log(self.currents_ma), np.arange(len(self.currents_ma)))
        low = level.astype(int)
        high, part = np.minimum(low + 1, len(self.currents_ma) - 1), level - low
        mu = (1 - part)[:, None] * self.mu[np.ix_(rows, low)] + part[:, None] * self.mu[np.ix_(rows, high)]
        strongest = (1 - part) * self.strongest[np.ix_(rows, low)]
        strongest += part * self.strongest[np.ix_(rows, high)]
        return weak[:, None] * mu, weak * strongest


def load_responses(path: Path) -> Responses:
    """Read the traversal's dataset.

    Raises:
        DatasetError: the file is missing, damaged, or lacks columns.
    """
    import pyarrow.parquet as pq

    muscles = [f"mu_{MODEL_GROUPS[m.rsplit('_', 1)[0]]}_{m.rsplit('_', 1)[1]}" for m in MUSCLES]
    contacts = [f"contact_{i}" for i in range(CONTACTS)]
    try:
        require_regular(path)
        table = pq.read_table(path, columns=["current", *contacts, *muscles, "g"])
    except (OSError, ValueError, KeyError) as error:
        raise DatasetError(f"{path}: cannot be read as the stimulation dataset: {error}") from None
    missing = [c for c in ("current", *contacts, *muscles, "g") if c not in table.column_names]
    if missing:
        raise DatasetError(f"{path}: columns {', '.join(missing)} are missing")
    current = table["current"].to_numpy().astype(float)
    levels = len(np.unique(current))
    if levels == 0 or len(current) % levels or (current.reshape(-1, levels) != current[:levels]).any():
        raise DatasetError(f"{path}: its rows are not every configuration at every current, in order")
    polarity = np.stack([table[c].to_numpy() for c in contacts], axis=1)[::levels]
    mu = np.stack([table[m].to_numpy() for m in muscles], axis=1).astype(float)
    currents = np.array([float(f"{c:.6g}") for c in current[:levels]])  # stored in single precision
    return Responses(
        {tuple(row): i for i, row in enumerate(polarity.tolist())},
        currents,
        mu.reshape(len(polarity), levels, len(MUSCLES)),
        1.0 - table["g"].to_numpy().astype(float).reshape(len(polarity), levels),
    )
