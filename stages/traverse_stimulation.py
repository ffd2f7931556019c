"""Activation, selectivity and safety of all 21,800 configurations at ten currents: 218,000 rows."""

from __future__ import annotations

import resource
import time

import numpy as np

from hdsafebo.files.atomic import write_json
from hdsafebo.pipeline.stage import Stage, run_stage
from hdsafebo.spinal.activating_function import sample
from hdsafebo.spinal.configurations import enumerate_configurations
from hdsafebo.spinal.dataset import to_table, write_dataset
from hdsafebo.spinal.figures import save_figure, selectivity_figure
from hdsafebo.spinal.geometry.anatomy import Anatomy
from hdsafebo.spinal.lead_field import LeadField
from hdsafebo.spinal.muscles import districts
from hdsafebo.spinal.summary import selectivity_summary
from hdsafebo.spinal.traversal import traverse


def main(stage: Stage) -> None:
    """Traverse the stimulation parameters and write the dataset."""
    settings = stage.params.spinal
    anatomy = Anatomy().overridden(settings.anatomy)
    field = LeadField.load(stage.path("data/spinal/lead_field.npz"))
    field.require(anatomy)
    start = time.perf_counter()
    low, high = anatomy.place("L1", end=False), anatomy.place("S2", end=True)
    activating = sample(field, low, high, settings.sample_spacing, settings.sample_slices)
    result = traverse(
        activating,
        districts(anatomy, settings.districts),
        enumerate_configurations(),
        np.array(settings.currents),
        settings.safety_threshold,
    )
    table = to_table(result)
    path = stage.path("data/spinal/stimulation.parquet")
    write_dataset(table, path)
    figure = selectivity_figure(table, "left", settings.safety_threshold)
    save_figure(figure, stage.path("data/spinal/selectivity.png"))
    summary = {
        "rows": table.num_rows,
        "safe_share": float(np.mean(result.g >= settings.safety_threshold)),
        "activation_threshold": result.threshold,
        "seconds": time.perf_counter() - start,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "file_mb": path.stat().st_size / 1e6,
    }
    write_json(
        stage.path("data/spinal/selectivity.json"), selectivity_summary(table, settings.safety_threshold)
    )
    write_json(stage.path("data/spinal/traversal.json"), summary)
    stage.log_metrics(summary)


if __name__ == "__main__":
    run_stage("traverse_stimulation", main, blocks=["spinal"])
