"""Play the best safe policies of three methods on the hand again, and draw them."""

from __future__ import annotations

from typing import Any

from hdsafebo.errors import RenderingUnavailableError
from hdsafebo.files.atomic import write_json
from hdsafebo.hand.filmstrip import filmstrip, frame_steps, seconds_of
from hdsafebo.hand.render import record_video
from hdsafebo.pictures.video import save_png
from hdsafebo.pipeline.stage import Stage, run_stage
from hdsafebo.problems.hand_replay import Replay, replay, scene_of
from hdsafebo.runs.best_trial import BestTrial, best_trial

FIRST = ("hdsafebo", "hdsafebo_local")
SHOWN = 3
FOLDER = "data/policies"


def main(stage: Stage) -> None:
    """Write one strip of pictures per policy, what each did, and a video of the best."""
    hand = stage.params.hand
    chosen = _choose(stage)
    played = [(trial, replay(hand, trial.z, latent=trial.latent, root=stage.root)) for trial in chosen]
    steps = frame_steps(hand.scene.horizon)
    missing = None
    names: list[str | None] = [None] * len(played)
    try:
        for k, (trial, episode) in enumerate(played):
            name = f"{k + 1}_{trial.method}.png"
            save_png(filmstrip(scene_of(hand), episode.excitations, steps), stage.path(f"{FOLDER}/{name}"))
            names[k] = name
        _film(stage, played)
    except RenderingUnavailableError as error:
        missing = str(error)
        stage.notice(f"no pictures of the best policies: {missing}")
    content = {
        "frames_at_s": seconds_of(steps),
        "missing": missing,
        "policies": [_record(*entry, name) for entry, name in zip(played, names, strict=True)],
    }
    write_json(stage.path(f"{FOLDER}/policies.json"), content)
    stage.log_artifact(stage.path(FOLDER))


def _choose(stage: Stage) -> list[BestTrial]:
    """Best trials of both variants of HdSafeBO, and of the other method that is best in the mean.

    All of one setting: the last that the parameters name.
    """
    hand = stage.params.tasks.hand
    paths = [stage.root / f"data/runs/{hand.tasks[-1]}-{method}.parquet" for method in hand.methods]
    found = {trial.method: trial for path in paths if (trial := best_trial(path)) is not None}
    first = [found[method] for method in FIRST if method in found]
    others = sorted(
        (trial for trial in found.values() if trial.method not in FIRST),
        key=lambda trial: trial.mean_best,
        reverse=True,
    )
    return [*first, *others][:SHOWN]


def _film(stage: Stage, played: list[tuple[BestTrial, Replay]]) -> None:
    """Video of the policy that did best when played again."""
    done = [episode for _, episode in played if episode.total_reward is not None]
    if done:
        best = max(done, key=lambda episode: episode.total_reward or 0.0)
        record_video(scene_of(stage.params.hand), best.excitations, stage.path(f"{FOLDER}/best_policy.mp4"))


def _record(trial: BestTrial, episode: Replay, picture: str | None) -> dict[str, Any]:
    """What the report says of a policy."""
    return {
        "method": trial.method,
        "seed": trial.seed,
        "trial": trial.trial,
        "objective": trial.objective,
        "replayed": episode.total_reward,
        "tilt": episode.tilt,
        "upright": episode.upright,
        "dropped": episode.dropped,
        "failure": episode.failure,
        "picture": picture,
    }


if __name__ == "__main__":
    run_stage("replay_policies", main, blocks=["hand"])
