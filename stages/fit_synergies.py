"""Fit muscle synergies to the recorded activations, and see what random policies over them do."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from hdsafebo.campaign.executor import process_pool
from hdsafebo.errors import DatasetError
from hdsafebo.files.bounded import require_regular
from hdsafebo.hand.reference import Difficulty, observation_moment, save_moment
from hdsafebo.hand.rollout import Scene, evaluate_policies
from hdsafebo.hand.synergies import fit_synergies, save_synergies, synergy_policies
from hdsafebo.pipeline.stage import Stage, run_stage


def main(stage: Stage) -> None:
    """Fit the synergies, then see what random policies over them do and observe."""
    params = stage.params.hand
    scene = Scene(params.scene.variant, params.scene.roll, params.scene.horizon)
    hand = scene.simulation().hand
    synergies = fit_synergies(_read(stage.path("data/rollouts/activations.parquet")), hand)
    save_synergies(stage.path("models/synergies/pca.safetensors"), synergies)
    shares = {f"variance_of_{k + 1}": float(share) for k, share in enumerate(synergies.explained)}

    settings = params.synergies
    space = synergy_policies(scene, synergies, settings.count)
    rng = np.random.default_rng(settings.seed)
    policies = rng.uniform(-settings.box, settings.box, (settings.random_policies, space.dimension))
    workers = stage.params.compute.workers or len(os.sched_getaffinity(0))
    with process_pool(workers) as executor:
        episodes = evaluate_policies(scene, space, policies, executor)
        moment = observation_moment(scene, space, policies[: settings.reference_policies], executor)
    save_moment(stage.path("models/synergies/observations.safetensors"), moment, hand)
    zero = evaluate_policies(scene, space, np.zeros((1, space.dimension)))
    difficulty = Difficulty.of(episodes, zero, params.synergies.landing_limit)
    difficulty.write(stage.path("data/synergies/random_policies.json"))
    stage.log_metrics({**shares, "random_dropped": difficulty.dropped, "random_upright": difficulty.upright})
    if difficulty.trivial:
        stage.notice(
            f"the task is easy on these synergies: {difficulty.upright:.0%} of random policies end upright, "
            f"the zero policy {'too' if difficulty.zero_policy_upright else 'does not'}; mind the controls"
        )


def _read(path: Path) -> pd.DataFrame:
    """The recorded activations."""
    try:
        require_regular(path)
        return pq.read_table(path).to_pandas()
    except (OSError, pa.ArrowException) as error:
        raise DatasetError(f"{path}: cannot be read as activations: {error}") from None


if __name__ == "__main__":
    run_stage("fit_synergies", main, blocks=["hand"])
