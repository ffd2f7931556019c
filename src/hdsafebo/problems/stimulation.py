"""Selective stimulation of a leg muscle among 218,000 parameters (paper, stimulation task).

The input is the field map of a stimulation (728 pixels), but only the maps of the dataset can be
evaluated: a decoded map takes the value of the nearest row that was not yet evaluated.

In the paper's setting (`scs_st`) the latent space is that of a learned embedding of the maps, the kernel sees
its codes, and g is modelled as it is. In the informed one (`scs_st_informed`) the kernel sees the logarithms
of the responses of axons, the latent space holds their principal components, and the logarithm of g is
modelled.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from hdsafebo.embeddings.base import Embedding
from hdsafebo.embeddings.registry import load_embedding
from hdsafebo.errors import DatasetError, UnknownNameError
from hdsafebo.files.bounded import require_regular
from hdsafebo.params import Params
from hdsafebo.params.tasks import ScsProblem
from hdsafebo.problem import Problem, Safety
from hdsafebo.problems.knowledge import TaskKnowledge
from hdsafebo.problems.registry import INFORMED_SUFFIX, Task, is_informed
from hdsafebo.spinal.configurations import CONFIGURATIONS, enumerate_configurations
from hdsafebo.spinal.field_map import PIXELS, REFERENCE_CURRENT_MA, field_maps, unit_potentials
from hdsafebo.spinal.nearest import NearestMap
from hdsafebo.spinal.point_sources import unit_responses
from hdsafebo.trials import Evaluation, Trials
from hdsafebo.typing import FloatArray, IntArray

DATASET_FILE = "data/spinal/stimulation.parquet"
MUSCLES = {"il": "IL", "vlrf": "VL&RF", "ta": "TA", "bfgm": "BF&GM", "st": "ST", "ga": "GA"}
_LOG_OFFSET = 0.005  # keeps the logarithm of a safety value of 0 finite
_ENCODED_AT_ONCE = 4096  # maps of 728 pixels: 24 MB


class StimulationSet:
    """The rows that can be evaluated; implements `problem.CandidateSet`.

    Row i * K + k is configuration i at the k-th of K currents.

    Args:
        currents_ma: (K,) currents, increasing.
        features: gives the (21800 K, p) kernel inputs of all rows; called when they are first asked for,
            since only methods that choose among rows need them. None takes the responses of axons, see
            `log_responses`: maps of low current all meet at one point although the selectivity depends on
            direction, so distances between maps say less.

    Attributes:
        unit: (21800, 728) unit potentials.
        currents_ma: as given.
    """

    def __init__(
        self, currents_ma: FloatArray, features: Callable[[StimulationSet], FloatArray] | None = None
    ) -> None:
        self._polarity = enumerate_configurations()
        self.unit = unit_potentials(self._polarity)
        self.currents_ma = currents_ma
        self._features = features
        self._nearest = NearestMap(self.unit, currents_ma)

    @cached_property
    def features(self) -> FloatArray:
        """(21800 K, p) inputs of the kernel."""
        if self._features is not None:
            return self._features(self)
        return log_responses(unit_responses(self._polarity), self.currents_ma)

    @cached_property
    def identifying(self) -> FloatArray:
        """(21800 K, 1) random sums of the rows' maps, which tell this set from another."""
        weights = np.random.default_rng(0).uniform(0.5, 1.0, self.unit.shape[1])
        return np.asarray((self.unit @ weights)[:, None] * self.currents_ma).reshape(-1, 1)

    def __len__(self) -> int:
        return len(self._nearest)

    def inputs(self, rows: IntArray) -> FloatArray:
        """(k, 728) field maps of rows."""
        configuration, current = np.divmod(np.asarray(rows), len(self.currents_ma))
        return np.asarray(field_maps(self.unit[configuration], self.currents_ma[current]))

    def nearest(self, x: FloatArray, taken: IntArray) -> IntArray:
        """(n,) rows whose maps are nearest to the (n, 728) maps `x`, all different and none in `taken`."""
        return np.asarray(self._nearest.query(x, taken)[0], dtype=np.int64)

    def same(self, x: FloatArray) -> IntArray:
        """(n,) rows whose maps are nearest to the (n, 728) maps `x`, whether taken or not."""
        return np.asarray(self._nearest.nearest_rows(x)[0], dtype=np.int64)

    def weakest(self) -> IntArray:
        """Rows at the lowest current, on which most of the set is safe."""
        return np.arange(0, len(self), len(self.currents_ma))


class ResponseCodec:
    """The informed latent space: principal components of the responses of axons; implements `problem.Codec`.

    A code stands for a row whose code is nearest; a configuration and its reverse have the same code.

    Args:
        rows: the set, with responses as features.
        components: d, number of components.

    Attributes:
        codes: (N, d) codes of all rows.
        share: of the variance of the responses that the components hold.
    """

    def __init__(self, rows: StimulationSet, components: int) -> None:
        features = rows.features - rows.features.mean(axis=0)
        values, vectors = np.linalg.eigh(features.T @ features)
        leading = vectors[:, ::-1][:, :components]
        leading = leading * np.where(leading.sum(axis=0) < 0, -1.0, 1.0)  # LAPACK leaves the signs open
        self.codes = features @ leading
        self.share = float(values[::-1][:components].sum() / values.sum())
        self._rows = rows
        self._tree = cKDTree(self.codes)

    def encode(self, x: FloatArray) -> FloatArray:
        """(n, d) codes of the rows whose maps are nearest to the (n, 728) maps."""
        return np.asarray(self.codes[self._rows.same(x)])

    def decode(self, z: FloatArray) -> FloatArray:
        """(n, 728) maps of the rows whose codes are nearest."""
        return self._rows.inputs(np.asarray(self._tree.query(z)[1]))


class SelectiveStimulation(Problem):
    """Selectivity index of one muscle under the share of the most activated muscle.

    Args:
        target: task suffix of the muscle, a key of `MUSCLES`.
        rows: the set that can be evaluated.
        selectivity: (N,) selectivity index of the target per row.
        safety: (N,) g = 1 - max_i mu_i per row.
        threshold: least g of a safe row.
        log_safety: model log(g + 0.005) with its threshold moved along; g itself piles up at zero.
        name: of the task; None is `scs_` and the target.

    Raises:
        DatasetError: no row is safe.
    """

    depends_on_history = False
    candidates: StimulationSet

    def __init__(
        self,
        target: str,
        rows: StimulationSet,
        selectivity: FloatArray,
        safety: FloatArray,
        *,
        threshold: float,
        log_safety: bool,
        name: str | None = None,
    ) -> None:
        self.name = f"scs_{target}" if name is None else name
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


def make_task(name: str, params: Params, *, seed: int, root: Path) -> Task:
    """The task of a muscle in one of its settings; see `problems.registry`."""
    target = name.removeprefix("scs_").removesuffix(INFORMED_SUFFIX)
    if target not in MUSCLES:
        raise UnknownNameError("stimulation target", target, sorted(MUSCLES))
    scs = params.tasks.scs
    files = [DATASET_FILE] if is_informed(name) else [DATASET_FILE, embedding_file(scs.problem.embedding)]
    versions = tuple(_version(root / file) for file in files)
    return _task(name, target, scs.problem, scs.informed.components, root, versions)


@lru_cache(maxsize=1)  # all seeds of a method have the same task, and to encode its rows takes half a minute
def _task(
    name: str, target: str, settings: ScsProblem, components: int, root: Path, versions: tuple[object, ...]
) -> Task:
    """The task, given what tells its files from those that may be in their place later."""
    currents, selectivity, safety = read_target(root / DATASET_FILE, MUSCLES[target], settings.side)

    def problem(rows: StimulationSet) -> SelectiveStimulation:
        return SelectiveStimulation(
            target,
            rows,
            selectivity,
            safety,
            threshold=settings.threshold,
            log_safety=is_informed(name),
            name=name,
        )

    if is_informed(name):
        return _informed(problem(StimulationSet(currents)), components)
    file = embedding_file(settings.embedding)
    embedding = load_embedding(root / file, input_dim=PIXELS)
    return _as_in_the_paper(problem(StimulationSet(currents, embedded_rows(embedding))), embedding, file)


def _version(path: Path) -> tuple[int, int] | None:
    """Of a file: when it was written, and its size; None for a missing one, which whoever reads it names."""
    if not path.is_file():
        return None
    status = path.stat()
    return status.st_mtime_ns, status.st_size


def embedding_file(embedding: str) -> str:
    """Where the pipeline keeps an embedding of the maps, relative to its root."""
    return f"models/embeddings/{embedding}.safetensors"


def _as_in_the_paper(problem: SelectiveStimulation, embedding: Embedding, file: str) -> Task:
    return Task(
        problem,
        lambda initial: embedding,
        inputs=(DATASET_FILE, file),
        latent_bounds=embedding.code_box,
        knowledge=TaskKnowledge(
            latent_space=(
                f"{embedding.latent_dim} codes of {embedding.name}, the box of the codes that it was trained "
                "on"
            ),
            candidate_rows=f"{len(problem.candidates):,} rows, their codes as kernel features",
            safety="g = 1 - the largest activation, as it is",
        ),
    )


def _informed(problem: SelectiveStimulation, components: int) -> Task:
    codec = ResponseCodec(problem.candidates, components)
    return Task(
        problem,
        lambda initial: codec,
        inputs=(DATASET_FILE,),
        latent_bounds=np.stack([codec.codes.min(axis=0), codec.codes.max(axis=0)]),
        knowledge=TaskKnowledge(
            latent_space=(
                f"{components} principal components of the responses of axons "
                f"({100 * codec.share:.1f} % of their variance), the box of all rows"
            ),
            candidate_rows=(
                f"{len(problem.candidates):,} rows, {problem.candidates.features.shape[1]} logarithms of "
                "responses of axons as kernel features"
            ),
            safety="g = 1 - the largest activation, its logarithm",
        ),
    )


def embedded_rows(embedding: Embedding) -> Callable[[StimulationSet], FloatArray]:
    """Kernel features of rows in the paper's setting: their codes, as all methods see them."""

    def features(rows: StimulationSet) -> FloatArray:
        blocks = np.array_split(np.arange(len(rows)), max(1, len(rows) // _ENCODED_AT_ONCE))
        return np.concatenate([embedding.encode(rows.inputs(block)) for block in blocks])

    return features


def read_target(path: Path, muscle: str, side: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Currents (K,) in mA, selectivity index (N,) of a muscle and safety values (N,) of the dataset.

    Raises:
        DatasetError: the file is missing or damaged, or its rows are not all configurations at all
            currents in order.
    """
    column = f"si_{muscle}_{side}"
    try:
        require_regular(path)
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
