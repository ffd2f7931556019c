"""Train SAC agents on the hand under several observation settings and record muscle activations."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from hdsafebo.campaign.executor import execute
from hdsafebo.errors import RenderingUnavailableError
from hdsafebo.hand.render import pictures, record_video
from hdsafebo.hand.rollout import Scene
from hdsafebo.hand.training.activations import (
    Agent,
    activation_table,
    agents_of,
    best_agent,
    explorations,
    explore,
    learning_curve,
)
from hdsafebo.hand.training.actor import save_actors
from hdsafebo.hand.training.train import PROGRESS_STEPS, SacSettings, Trained, Training, train_agent
from hdsafebo.pictures.video import save_png
from hdsafebo.pipeline.stage import Stage, run_stage
from hdsafebo.progress import Advance, progress

Item = TypeVar("Item")
Result = TypeVar("Result")


def main(stage: Stage) -> None:
    """Train the agents, keep the best, record activations of all checkpoints, and draw what it looks like."""
    hand = stage.params.hand
    scene = Scene(hand.scene.variant, hand.scene.roll, hand.scene.horizon)
    with tempfile.TemporaryDirectory() as folder:
        trained = _train(stage, scene, Path(folder))
        agents = agents_of(trained)
        best, excitations = best_agent(scene, agents)
        shutil.copyfile(Path(folder) / f"{best.setting}.zip", stage.path("models/sac/policy.zip"))
    digest = scene.simulation().hand.digest
    save_actors(stage.path("models/sac/actors.safetensors"), {a.name: a.actor for a in agents}, digest)
    table = _record(stage, scene, agents)
    _write(table, stage.path("data/rollouts/activations.parquet"))
    _write(learning_curve(trained), stage.path("data/rollouts/learning_curve.parquet"))
    finals = {f"{t.setting}_final_reward": float(np.mean(t.total_reward[-10:])) for t in trained}
    stage.log_metrics({"activation_rows": len(table), **finals})
    _draw(stage, scene, excitations)


def _train(stage: Stage, scene: Scene, folder: Path) -> list[Trained]:
    """One agent per observation setting."""
    sac = stage.params.hand.sac
    size = SacSettings(sac.steps, sac.width, sac.train_every, sac.updates)
    jobs = [Training(scene, setting, size, sac.seed, folder) for setting in dict.fromkeys(sac.settings)]
    with progress(len(jobs) * sac.steps, "train SAC agents") as advance:
        return _in_order(stage, train_agent, jobs, _TrainingWatcher(jobs, advance), lambda: None)


def _record(stage: Stage, scene: Scene, agents: Sequence[Agent]) -> pd.DataFrame:
    """Activations of exploring episodes of all agents."""
    rollouts = stage.params.hand.rollouts
    jobs = explorations(scene, agents, rollouts.episodes, rollouts.seed)
    with progress(len(jobs), "record activations") as advance:
        blocks = _in_order(stage, explore, jobs, _Silent(), advance)
    return activation_table(blocks, scene.simulation().hand.muscles)


def _draw(stage: Stage, scene: Scene, excitations: NDArray[np.float64]) -> None:
    """Picture of the start pose and video of the best agent; says so where nothing can be drawn."""
    try:
        save_png(pictures(scene, excitations, [0])[0], stage.path("data/rollouts/start_pose.png"))
        video = stage.path("data/rollouts/best_agent.mp4")
        record_video(scene, excitations, video)
        stage.log_artifact(video)
    except RenderingUnavailableError as error:
        stage.notice(f"no picture of the start pose and no video of the best agent: {error}")


def _in_order(
    stage: Stage,
    function: Callable[[Item], Result],
    jobs: Sequence[Item],
    watcher: _Silent,
    advance: Callable[[], object],
) -> list[Result]:
    """Results of the jobs in their order, computed in parallel."""
    results: dict[int, Result] = {}
    numbers = {id(job): number for number, job in enumerate(jobs)}

    def keep(job: Item, result: Result) -> None:
        results[numbers[id(job)]] = result
        advance()

    compute = stage.params.compute
    execute(function, jobs, keep, watcher, workers=compute.workers, scheduler=compute.scheduler)
    return [results[number] for number in range(len(jobs))]


class _Silent:
    """Watches nothing."""

    def poll(self) -> None:
        """Nothing to read."""

    def stop(self) -> None:
        """Jobs are short enough to end by themselves."""


class _TrainingWatcher(_Silent):
    """Reads how far the agents are."""

    def __init__(self, jobs: Sequence[Training], advance: Advance) -> None:
        self._files = [job.progress for job in jobs]
        self._advance = advance
        self._seen = 0

    def poll(self) -> None:
        """Move the bar by what was trained since the last look."""
        done = sum(file.stat().st_size for file in self._files if file.exists()) * PROGRESS_STEPS
        self._advance(done - self._seen)
        self._seen = done


def _write(table: pd.DataFrame, path: Path) -> None:
    """Write a table as parquet."""
    pq.write_table(pa.Table.from_pandas(table, preserve_index=False), path, compression="zstd")


if __name__ == "__main__":
    run_stage("collect_rollouts", main, blocks=["hand"])
