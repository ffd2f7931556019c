"""Selective stimulation of a leg muscle among 218,000 parameters (paper, stimulation task).

The input is the field map of a stimulation (728 pixels), but only the maps of the dataset can be
evaluated: a decoded map takes the value of the nearest row that was not yet evaluated.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from hdsafebo.embeddings.registry import load_embedding
from hdsafebo.errors import DatasetError, UnknownNameError
from hdsafebo.params import Params
from hdsafebo.problem import Codec, Problem, Safety
from hdsafebo.problems.registry import Task
from hdsafebo.spinal.configurations import CONFIGURATIONS, enumerate_configurations
from hdsafebo.spinal.field_map import PIXELS, REFERENCE_CURRENT_MA, field_maps, unit_potentials
from hdsafebo.spinal.nearest import NearestMap
from hdsafebo.spinal.point_sources import unit_responses
from hdsafebo.trials import Evaluation, Trials
from hdsafebo.typing import FloatArray, IntArray

DATASET_FILE = "data/spinal/stimulation.parquet"
MUSCLES = {"il": "IL", "vlrf": "VL&RF", "ta": "TA", "bfgm": "BF&GM", "st": "ST", "ga": "GA"}
_LOG_OFFSET = 0.005  # keeps the logarithm of a safety value of 0 finite


@dataclass(frozen=True)
class StimulationSet:
    """The rows that can be evaluated; implements `problem.CandidateSet`.

    Row i * K + k is configuration i at the k-th of K currents.

    Attributes:
        unit: (21800, 728) unit potentials.
        currents_ma: (K,) currents.
        features: (21800 K, 84) inputs of the kernel, see `log_responses`. Maps of low current all meet at the
            origin although the selectivity depends on direction, so distances between maps say less.
    """

    unit: FloatArray
    currents_ma: FloatArray
    features: FloatArray
    _nearest: NearestMap

    @classmethod
    def build(cls, currents_ma: FloatArray) -> StimulationSet:
        """The set of all configurations at the given currents."""
        polarity = enumerate_configurations()
        unit = unit_potentials(polarity)
        features = log_responses(unit_responses(polarity), currents_ma)
        return cls(unit, currents_ma, features, NearestMap(unit, currents_ma))

    def __len__(self) -> int:
        return len(self.features)

    def inputs(self, rows: IntArray) -> FloatArray:
        """(k, 728) field maps of rows."""
        configuration, current = np.divmod(np.asarray(rows), len(self.currents_ma))
        return np.asarray(field_maps(self.unit[configuration], self.currents_ma[current]))

    def nearest(self, x: FloatArray, taken: IntArray) -> IntArray:
        """(n,) rows whose maps are nearest to the (n, 728) maps `x`, all different and none in `taken`."""
        return np.asarray(self._nearest.query(x, taken)[0], dtype=np.int64)

    def weakest(self) -> IntArray:
        """Rows at the lowest current, on which most of the set is safe."""
        return np.arange(0, len(self), len(self.currents_ma))


class SelectiveStimulation(Problem):
    """Selectivity index of one muscle under the share of the most activated muscle.

    Args:
        target: task suffix of the muscle, a key of `MUSCLES`.
        rows: the set that can be evaluated.
        selectivity: (N,) selectivity index of the target per row.
        safety: (N,) g = 1 - max_i mu_i per row.
        threshold: least g of a safe row.
        log_safety: model log(g + 0.005) with its threshold moved along; g itself piles up at zero.

    Raises:
        DatasetError: no row is safe.
    """

    depends_on_history = False

    def __init__(
        self,
        target: str,
        rows: StimulationSet,
        selectivity: FloatArray,
        safety: FloatArray,
        *,
        threshold: float,
        log_safety: bool,
    ) -> None:
        self.name = f"scs_{target}"
        self.candidates = rows
        self.selectivity = selectivity
        self.values = safety
        lowest = 1.0 - rows.currents_ma.max() / REFERENCE_CURRENT_MA
        self.bounds = np.vstack([np.full(PIXELS, lowest), np.ones(PIXELS)])
        self.safety = (Safety("inactive_share", threshold, transform=_log_transform if log_safety else None),)
        safe = safety >= threshold
        if not safe.any():
            raise DatasetError(f"{self.name}: no row has g >= {threshold}; largest {safety.max():.3f}")
        self.optimum = float(selectivity[safe].max())

    def evaluate(self, trials: Trials) -> Evaluation:
        """Look the rows up."""
        rows = trials.candidate
        if (rows < 0).any() or (rows >= len(self.values)).any():
            raise DatasetError(f"{self.name}: trials without a row of the dataset: {trials.id[rows < 0]}")
        return Evaluation(self.selectivity[rows], self.values[rows][:, None])


def make_task(name: str, params: Params, *, method: str, seed: int, root: Path) -> Task:
    """The task of a muscle; see `problems.registry.make_task`."""
    settings = params.tasks.scs.problem
    target = name.removeprefix("scs_")
    if target not in MUSCLES:
        raise UnknownNameError("stimulation target", target, sorted(MUSCLES))
    currents, selectivity, safety = read_target(root / DATASET_FILE, MUSCLES[target], settings.side)
    problem = SelectiveStimulation(
        target,
        StimulationSet.build(currents),
        selectivity,
        safety,
        threshold=settings.threshold,
        log_safety=method.startswith("hdsafebo_local"),
    )
    embedding_file = f"models/embeddings/{settings.embedding}.safetensors"

    def latent(initial_inputs: FloatArray) -> Codec:
        return load_embedding(root / embedding_file, input_dim=PIXELS)

    return Task(problem, latent, inputs=(DATASET_FILE, embedding_file))


def read_target(path: Path, muscle: str, side: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Currents (K,) in mA, selectivity index (N,) of a muscle and safety values (N,) of the dataset.

    Raises:
        DatasetError: the file is missing or damaged, or its rows are not all configurations at all
            currents in order.
    """
    column = f"si_{muscle}_{side}"
    try:
        table = pq.read_table(path, columns=["configuration", "current", column, "g"])
    except (OSError, ValueError, KeyError) as error:
        raise DatasetError(f"{path}: cannot be read as the stimulation dataset: {error}") from error
    if column not in table.column_names:
        raise DatasetError(f"{path}: has no column {column}")
    columns: dict[str, NDArray] = {key: table[key].to_numpy() for key in table.column_names}
    currents = np.unique(columns["current"]).astype(float)
    expected = np.repeat(np.arange(CONFIGURATIONS), len(currents))
    in_order = len(table) == len(expected) and (columns["configuration"] == expected).all()
    if not in_order or (columns["current"].reshape(CONFIGURATIONS, -1) != currents.astype(np.float32)).any():
        raise DatasetError(
            f"{path}: {len(table)} rows, expected {len(expected)}, every configuration at every current"
        )
    selectivity, safety = columns[column].astype(float), columns["g"].astype(float)
    if not (np.isfinite(selectivity).all() and np.isfinite(safety).all()):
        raise DatasetError(f"{path}: {column} or g holds NaN or infinite values")
    return currents, selectivity, safety


def log_responses(unit: FloatArray, currents_ma: FloatArray) -> FloatArray:
    """Logarithms of the responses of axons to every configuration at every current, as kernel inputs.

    Activation is a matter of ratios: twice the current moves all logarithms alike, and where the responses
    are strong shows in their differences. Those well below the median at the weakest current hardly count.

    Args:
        unit: (n, p) responses at 1 mA, see `spinal.point_sources`.
        currents_ma: (K,) currents, increasing.

    Returns:
        (n K, p) features of mean zero and of a mean squared distance of one.
    """
    floor = currents_ma[0] * np.median(unit)
    features = np.log(floor + currents_ma[:, None] * unit[:, None]).reshape(-1, unit.shape[1])
    features -= features.mean(axis=0)
    features /= np.sqrt(2.0 * features.var(axis=0).sum())
    return np.asarray(features)


def _log_transform(g: FloatArray) -> FloatArray:
    return np.asarray(np.log(np.asarray(g) + _LOG_OFFSET))
