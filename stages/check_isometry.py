"""Measure how well each embedding keeps distances and finds its way back; stop below the floors."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from hdsafebo.embeddings import load_embedding
from hdsafebo.embeddings.distances import sample_pairs
from hdsafebo.embeddings.isometry import IsometryCheck, IsometryMeasures, RoundTrip
from hdsafebo.errors import EmbeddingFileError, ParamsError
from hdsafebo.files.atomic import write_json
from hdsafebo.params import IsometryParams
from hdsafebo.pipeline.stage import Stage, run_stage
from hdsafebo.progress import track
from hdsafebo.spinal.configurations import CONFIGURATIONS, enumerate_configurations
from hdsafebo.spinal.field_map import PIXELS, unit_potentials
from hdsafebo.spinal.nearest import NearestMap


def main(stage: Stage) -> None:
    """Measure every embedding, write the report, then stop if one of them is below a floor."""
    settings, names = stage.params.isometry, list(stage.params.embeddings.models)
    for name in settings.floors:
        if name not in names:
            raise ParamsError(f"isometry.floors.{name}: no such embedding under embeddings.models ({names})")
    held_out = _held_out(stage.path("models/embeddings/held_out.npy"))
    check = _check(settings, np.asarray(stage.params.spinal.currents), held_out)
    measured: dict[str, IsometryMeasures] = {}
    distances = {"original": check.original_distances}
    for name in track(names, "check isometry"):
        path = stage.path(f"models/embeddings/{name}.safetensors")
        measured[name], distances[name] = check.measure(load_embedding(path, input_dim=PIXELS))
        numbers = asdict(measured[name]).items()
        stage.log_metrics({f"{name}_{key}": value for key, value in numbers if value is not None})
    found = {name: asdict(measures) for name, measures in measured.items()}
    write_json(stage.path("reports/isometry.json"), found, sort_keys=True)
    shown = {key: value[: settings.figure_pairs].astype(np.float32) for key, value in distances.items()}
    pq.write_table(pa.table(shown), stage.path("reports/isometry_pairs.parquet"))
    for name, floors in settings.floors.items():
        measured[name].require(name, floors.model_dump(exclude_none=True))


def _check(
    settings: IsometryParams, currents: NDArray[np.float64], held_out: NDArray[np.intp]
) -> IsometryCheck:
    """The check on a sample of the field maps of the dataset."""
    rng = np.random.default_rng(settings.seed)
    unit = unit_potentials(enumerate_configurations())
    dataset = NearestMap(unit, currents)
    between = NearestMap(unit, np.sqrt(currents[:-1] * currents[1:]))  # currents that no training saw

    def trip(table: NearestMap, among: NDArray[np.intp]) -> RoundTrip:
        levels = len(table) // CONFIGURATIONS
        configuration, level = (rng.choice(choices, settings.round_trip_rows) for choices in (among, levels))
        rows = configuration * levels + level
        return RoundTrip(table.maps(rows), rows, table.nearest_rows)

    seen = np.delete(np.arange(CONFIGURATIONS), held_out)
    return IsometryCheck(
        points=dataset.maps(rng.choice(len(dataset), settings.points, replace=False)),
        pairs=sample_pairs(settings.points, settings.pairs, rng),
        seen=trip(dataset, seen),
        held_out=trip(dataset, held_out),
        held_out_currents=trip(between, seen),
        gp_points=settings.gp_points,
        gp_draws=settings.gp_draws,
        jacobian_points=settings.jacobian_points,
        seed=settings.seed,
    )


def _held_out(path: Path) -> NDArray[np.intp]:
    """Configurations that no training saw."""
    try:
        rows = np.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise EmbeddingFileError(f"{path}: no list of held-out configurations: {error}") from None
    wanted = rows.ndim == 1 and rows.size > 0 and rows.dtype.kind == "i"
    if not wanted or rows.min() < 0 or rows.max() >= CONFIGURATIONS:
        raise EmbeddingFileError(f"{path}: expected numbers of configurations, 0 to {CONFIGURATIONS - 1}")
    return np.asarray(rows, dtype=np.intp)


if __name__ == "__main__":
    run_stage("check_isometry", main, blocks=["isometry", "embeddings", "spinal.currents"])
