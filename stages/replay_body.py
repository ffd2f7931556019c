"""Play the best policies of the body and the best initial reflexes again, draw and film them."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from hdsafebo.errors import RenderingUnavailableError
from hdsafebo.files.atomic import replacing, write_json
from hdsafebo.pictures.video import save_png, write_video
from hdsafebo.pipeline.stage import Stage, run_stage
from hdsafebo.policies import GymnasiumPolicies
from hdsafebo.problems.body import RECORDED_FILE, load_observations, policies_of
from hdsafebo.problems.body_replay import FRAMES_PER_SECOND, beside, outcome_of, strip, weights_of
from hdsafebo.runs.best_trial import BestTrial, best_trials
from hdsafebo.typing import FloatArray

FOLDER = "data/body/policies"
REFLEX = "reflex"
SHOWN = "best_beside_reflex.mp4"


def main(stage: Stage) -> None:
    """Write what each policy did, a strip of pictures of the best and of a reflex, and a film of both."""
    settings = stage.params.tasks.body.problem
    policies = policies_of(settings, load_observations(stage.root / RECORDED_FILE))
    chosen = _chosen(stage)
    weights = [weights_of(settings, policies, trial.z, trial.space) for _, trial in chosen]
    played = [_record(stage, policies, *entry, w) for entry, w in zip(chosen, weights, strict=True)]
    missing = None
    try:
        _draw(stage, policies, played, weights, [trial.safe_enough for _, trial in chosen])
    except RenderingUnavailableError as error:
        missing = str(error)
        stage.notice(f"no pictures of the body: {missing}")
    content = {
        "horizon_s": settings.horizon / 100,
        "pushes": settings.pushes,
        "unseen_pushes": settings.unseen_pushes,
        "missing": missing,
        "policies": played,
    }
    write_json(stage.path(f"{FOLDER}/policies.json"), content)
    stage.log_artifact(stage.path(FOLDER))


def _chosen(stage: Stage) -> list[tuple[str, BestTrial]]:
    """By name: the best initial reflex of each seed, then the best proposed trial of each method and seed."""
    methods = stage.params.tasks.body.methods
    paths = {name: stage.root / f"data/runs/body-{name}.parquet" for name in methods}
    initial = (best_trials(path, initial=True) for path in paths.values())
    reflexes = next((trials for trials in initial if trials and trials[0].space == "original"), [])
    found = [(name, trial) for name in methods for trial in best_trials(paths[name])]
    return [*((REFLEX, trial) for trial in reflexes), *found]


def _record(
    stage: Stage, policies: GymnasiumPolicies, name: str, trial: BestTrial, weights: FloatArray
) -> dict[str, Any]:
    """What the report says of a policy."""
    unseen = stage.params.tasks.body.problem.unseen_pushes
    return {
        "method": name,
        "seed": trial.seed,
        "trial": trial.trial,
        "objective": trial.objective,
        "known": asdict(outcome_of(policies, weights, policies.seeds)),
        "unseen": asdict(outcome_of(policies, weights, unseen)) if unseen else None,
        "picture": None,
    }


def _shown(played: list[dict[str, Any]], safe_enough: list[bool]) -> int | None:
    """The best policy of methods that count as safe, or of all where none does; None if none is learnt."""
    learnt = [k for k, entry in enumerate(played) if entry["method"] != REFLEX]
    safe = [k for k in learnt if safe_enough[k]]
    return max(safe or learnt, key=lambda k: played[k]["objective"], default=None)


def _draw(
    stage: Stage,
    policies: GymnasiumPolicies,
    played: list[dict[str, Any]],
    weights: list[FloatArray],
    safe_enough: list[bool],
) -> None:
    """Strips of the best policy and of the best reflex of its seed, and a film of both side by side."""
    best = _shown(played, safe_enough)
    if best is None:
        return
    reflexes = [
        k
        for k, entry in enumerate(played)
        if entry["method"] == REFLEX and entry["seed"] == played[best]["seed"]
    ]
    films = {}
    for k in (best, *reflexes):
        films[k] = policies.film(weights[k], policies.seeds[0], FRAMES_PER_SECOND)
        name = f"{played[k]['method']}.png"
        save_png(strip(films[k].frames), stage.path(f"{FOLDER}/{name}"))
        played[k]["picture"] = name
    pair = [films[k].frames for k in (best, *reflexes)]
    with replacing(stage.path(f"{FOLDER}/{SHOWN}")) as temporary:
        write_video(beside(pair[0], pair[-1]), temporary, films[best].fps)


if __name__ == "__main__":
    run_stage("replay_body", main)
