"""Page, figures, tables, curves and summary from the result files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from hdsafebo.params import Params
from hdsafebo.pipeline.provenance import git_state
from hdsafebo.pipeline.stage import Stage, run_stage
from hdsafebo.report.build import build_report
from hdsafebo.report.data.results import Settings
from hdsafebo.spinal.field_map import COLUMNS, CONTACTS, ROWS, field_maps, unit_potentials

STIMULATION = "data/spinal/stimulation.parquet"
EXAMPLE = "si_ST_left"


def main(stage: Stage) -> None:
    """Write the report."""
    revision = git_state(stage.root)
    threshold = stage.params.tasks.scs.problem.threshold
    content = build_report(
        stage.root,
        profile=stage.params.profile,
        git_revision=None if revision is None else revision[0],
        safety_threshold=threshold,
        planned=_planned(stage.params),
        isometry_points=stage.params.isometry.points,
        settings=Settings(**stage.params.report.model_dump()),
        field_map=_example(stage.path(STIMULATION), threshold),
    )
    stage.log_metrics(_flat(content))
    for name in ("index.html", "summary.json", "figures", "tables"):
        stage.log_artifact(stage.path(f"reports/{name}"))


def _planned(params: Params) -> list[tuple[str, str]]:
    """Every task and method that the parameters run."""
    tasks = params.tasks
    methods = {"synthetic": tasks.synthetic.methods, "hand": tasks.hand.methods}
    methods |= {name: family.methods for family in (tasks.scs, tasks.digits) for name in family.tasks}
    return [(task, method) for task, names in methods.items() for method in names]


def _example(path: Path, threshold: float) -> tuple[NDArray[np.float64], str] | None:
    """Field map of the safe stimulation that selects the left ST best."""
    if not path.exists():
        return None
    contacts = [f"contact_{i}" for i in range(CONTACTS)]
    table = pq.read_table(path, columns=[EXAMPLE, "g", "current", *contacts])
    table = table.filter(pc.greater_equal(table["g"], threshold))
    if table.num_rows == 0:
        return None
    row = table.slice(int(np.argmax(table[EXAMPLE].to_numpy())), 1).to_pylist()[0]
    polarity = np.array([row[name] for name in contacts])
    current = float(row["current"])
    cathodes, anodes = (", ".join(str(i + 1) for i in np.flatnonzero(polarity == sign)) for sign in (-1, 1))
    title = (
        f"cathodes {cathodes}, anodes {anodes}, {current:.3g} mA, the best safe selection of ST on the left"
    )
    return field_maps(unit_potentials(polarity[None]), current)[0].reshape(ROWS, COLUMNS), title


def _flat(content: object, prefix: str = "") -> dict[str, float]:
    """Numbers of nested objects under dotted names."""
    if isinstance(content, dict):
        parts = (_flat(value, f"{prefix}{key}.") for key, value in content.items())
        return {name: number for part in parts for name, number in part.items()}
    if isinstance(content, int | float):
        return {prefix[:-1]: float(content)}
    return {}


if __name__ == "__main__":
    run_stage("report", main, blocks=["report"])
