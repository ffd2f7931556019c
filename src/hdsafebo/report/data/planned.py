"""Which run files belong to the report: those of the tasks and methods that the parameters name."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from hdsafebo.params import Params
from hdsafebo.runs.read import RunFile, read_run, read_runs
from hdsafebo.runs.schema import run_name


def planned_runs(params: Params) -> list[tuple[str, str]]:
    """Every task and method that the parameters run."""
    tasks = params.tasks
    methods = {"synthetic": tasks.synthetic.methods, "body": tasks.body.methods}
    methods |= {n: family.methods for family in (tasks.hand, tasks.scs, tasks.digits) for n in family.tasks}
    return [(task, method) for task, names in methods.items() for method in names]


def read_planned(
    folder: Path, planned: Collection[tuple[str, str]] | None
) -> tuple[dict[tuple[str, str], RunFile], list[str]]:
    """Run files by (task, method), and the names of the files that are left out.

    A method that was taken out of the parameters leaves its run file behind, perhaps of another size and made
    by older code; beside the others it would pass for a comparison.

    Args:
        folder: of the run files.
        planned: tasks and methods; None takes every file.

    Raises:
        DatasetError: a file that belongs to the report is malformed.
    """
    if planned is None:
        return read_runs(folder), []
    names = {run_name(task, method) for task, method in planned}
    paths = sorted(folder.glob("*.parquet"))
    runs = (read_run(path) for path in paths if path.stem in names)
    left_out = [path.name for path in paths if path.stem not in names]
    return {(run.meta.task, run.meta.method): run for run in runs}, left_out
