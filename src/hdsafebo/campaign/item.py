"""One item of the pipeline's matrix: all seeds of a method on a task, to one run file."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from hdsafebo.campaign.errors import CampaignError
from hdsafebo.campaign.executor import execute
from hdsafebo.campaign.progress import ProgressWatcher
from hdsafebo.campaign.run_spec import RunSpec, budget_of, settings_of
from hdsafebo.campaign.runner import RunResult, run
from hdsafebo.errors import JournalError, ParamsError
from hdsafebo.files.durable import make_durable_directory
from hdsafebo.params import Params
from hdsafebo.pipeline.store import home_of
from hdsafebo.pipeline.tracking import Tracker
from hdsafebo.problems.registry import family_of
from hdsafebo.progress import progress
from hdsafebo.runs.schema import RunMetadata, run_name
from hdsafebo.runs.series import per_round_of
from hdsafebo.runs.write import write_run_file


def run_path(task: str, method: str, root: Path) -> Path:
    """The run file of a method on a task."""
    return root / "data" / "runs" / f"{run_name(task, method)}.parquet"


def run_item(task: str, method: str, params: Params, root: Path, tracker: Tracker) -> list[RunResult]:
    """Run all seeds of a method on a task and write their file.

    Seeds whose rounds are in the journal are continued, or read if they are complete.

    Args:
        task: name of the task.
        method: name of the method's block in the parameters.
        params: the checked parameters.
        root: the project's directory.
        tracker: mirrors the runs as they finish.

    Returns:
        The runs in the order of their seeds.

    Raises:
        ParamsError: the parameters do not have the task or the method.
        CampaignError: worker processes or the cluster failed, or the code was changed meanwhile; finished
            rounds are kept.
        HdSafeBOError: what a run raised.
    """
    budget = budget_of(params, task)
    if method not in params.methods:
        raise ParamsError(f"methods: no block {method!r}; it has {', '.join(sorted(params.methods))}")
    seeds = list(budget.seeds_for(method))
    plain = params.model_dump(mode="json")
    settings = settings_of(params, task, method)
    block = plain["tasks"][family_of(task)]
    tracker.place(
        experiment=task,
        run_name=method,
        stage=f"optimize_{family_of(task)}",
        item={"task": task, "method": method},
        params={
            "problem": block["problem"],
            "budget": block["budget"],
            "algorithm": params.methods[method].algorithm,
            "space": params.methods[method].space,
            "settings": settings,
            "profile": params.profile,
        },
    )
    home = home_of(root)
    finished: dict[int, RunResult] = {}
    with (
        _shared_directory(home) as directory,
        progress(len(seeds) * budget.trials, f"{task} {method}") as advance,
    ):
        watcher = ProgressWatcher(Path(directory), seeds, advance)

        def on_result(spec: RunSpec, result: RunResult) -> None:
            finished[spec.seed] = result
            watcher.finish(spec.seed, budget.trials)
            curves = per_round_of([result.rows])
            tracker.log_child(
                f"{method} {spec.seed}",
                {"seed": spec.seed, "method": method, "task": task},
                curves.trials.astype(int).tolist(),
                curves.mean_curves(),
            )

        specs = [RunSpec(task, method, seed, plain, str(root), directory, str(home)) for seed in seeds]
        execute(
            run, specs, on_result, watcher, workers=params.compute.workers, scheduler=params.compute.scheduler
        )
    results = [finished[seed] for seed in seeds]
    metadata = RunMetadata(
        task=task,
        method=method,
        algorithm=params.methods[method].algorithm,
        profile=params.profile,
        settings=settings,
        n_initial=budget.initial,
        batch=budget.batch,
        n_trials=budget.trials,
        seeds=seeds,
        counts=[result.counts for result in results],
        code=_common_code(results),
        **_common_facts(results),
    )
    write_run_file(run_path(task, method, root), [result.rows for result in results], metadata)
    curves = per_round_of([result.rows for result in results])
    tracker.log_series(curves.trials.astype(int).tolist(), curves.mean_curves())
    return results


def _shared_directory(home: Path) -> tempfile.TemporaryDirectory[str]:
    """A directory that the workers see too, for as long as the campaign lasts."""
    parent = home / ".journal"
    try:
        make_durable_directory(parent)
        return tempfile.TemporaryDirectory(prefix="progress-", dir=parent, ignore_cleanup_errors=True)
    except OSError as error:
        raise JournalError(f"{parent}: cannot be written: {error.strerror}") from error


def _common_code(results: list[RunResult]) -> str:
    """Digest of the code that computed all of them; a comparison of seeds of different code means nothing."""
    first, *others = {result.code for result in results}
    if others:
        raise CampaignError("the code was changed while runs were computed: run them again, to have one code")
    return first


def _common_facts(results: list[RunResult]) -> dict[str, Any]:
    """Facts of the runs; the optimum is dropped where it depends on the seed."""
    facts = dict(results[0].facts)
    if any(result.facts["optimum"] != facts["optimum"] for result in results):
        facts["optimum"] = None
    return facts
