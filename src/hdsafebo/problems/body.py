"""Staying up after a push with a whole body: linear policies over all muscles, safe from the first trial on.

Objective: mean return over fixed pushes. Safety functions, the least of the pushes:

* `stands`: how much longer the body stays up than 1.4 s, as a share of the episode;
* `joint_load`: how far the torque of joint stops and couplings stays below 60 N m, in the mean over 0.1 s.
  Peaks are shorter than that, and as irregular as contacts are.

Both are computed from the episode alone. Initial policies are stretch and balance reflexes with random gains
about the muscle excitations that hold the posture; about a third of them is unsafe, and none stands for 5 s
after all pushes.

All weights are searched, or in their place the weights over joint-torque synergies (the space `torques`) or
the seven gains of the reflex (`gains`). A stage records once what reflexes observe, from which normalisation
and kernel features follow for every run.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from hdsafebo.bodies.environment import HORIZON
from hdsafebo.bodies.posture import posture_of
from hdsafebo.bodies.simulation import CONTROL_INTERVAL
from hdsafebo.errors import ProblemError, UnknownNameError
from hdsafebo.files.atomic import replacing
from hdsafebo.params import BodyProblem, Params
from hdsafebo.policies import GymnasiumPolicies
from hdsafebo.policies.safety import EpisodeSafety, budget, lasts
from hdsafebo.policies.synergies import ActionSynergies
from hdsafebo.problem import Codec
from hdsafebo.problems.knowledge import TaskKnowledge
from hdsafebo.problems.reflexes import (
    EXCITATION_UNIT,
    ReflexDesign,
    ReflexGainsProblem,
    as_action,
)
from hdsafebo.problems.registry import Task
from hdsafebo.typing import FloatArray

PUSHES = (1, 4, 9)
"""Seeds of the evaluation pushes: forwards to the right, forwards, forwards to the left; 0.09 to 0.17 m/s."""
UNSEEN_PUSHES = (101, 102, 103, 104, 105)
"""Seeds of pushes that no trial meets."""
LEAST_TIME = 1.4
"""s."""
MOST_LOAD = 60.0
"""N m."""
_SUSTAINED = round(0.1 / CONTROL_INTERVAL)
"""Control steps over which a load counts."""
ENVIRONMENTS = {"myofullbody": "hdsafebo/PushedBody-v0", "myolegs": "hdsafebo/PushedLegs-v0"}
RECORDED_FILE = "data/body/observations.npz"
RECORDED_REFLEXES = 8
_MOVES = 8
"""Main ways in which reflexes differ: they have seven gains, some of which have limits."""


def body_policies(
    body: str = "myofullbody",
    pushes: Sequence[int] = PUSHES,
    *,
    horizon: int = HORIZON,
    least_time: float = LEAST_TIME,
    most_load: float = MOST_LOAD,
    recorded: int | FloatArray = RECORDED_REFLEXES,
    executor: Executor | None = None,
) -> GymnasiumPolicies:
    """The problem of a body that stays up.

    Args:
        body: `myofullbody` or `myolegs`.
        pushes: seeds of the pushes that every trial meets.
        horizon: control steps of 10 ms.
        least_time: that the body must stay up, s.
        most_load: torque of joint stops and couplings, over 0.1 s, that it must stay below, N m.
        recorded: number of reflexes that are played to record observations, or recorded observations.
        executor: see `GymnasiumPolicies`.
    """
    return GymnasiumPolicies(
        ENVIRONMENTS[body],
        safety_functions(least_time, most_load),
        seeds=pushes,
        horizon=horizon,
        arguments={"horizon": horizon},
        base=as_action(posture_of(body).holding),
        unit=EXCITATION_UNIT,
        design=ReflexDesign(body),
        box="design",
        moves=_MOVES,
        effects=posture_of(body).torque.T / EXCITATION_UNIT,
        recorded=recorded,
        name=f"body_{body}",
        executor=executor,
    )


def torque_synergies(policies: GymnasiumPolicies, body: str = "myofullbody") -> ActionSynergies:
    """Policies whose muscles act together as joint torques need: one synergy per independent joint."""
    return policies.synergies(posture_of(body).excitation)


def safety_functions(least_time: float, most_load: float) -> list[EpisodeSafety]:
    """Those of the task, in physical units: seconds and N m."""
    return [
        lasts(round(least_time / CONTROL_INTERVAL), name="stands"),
        budget("joint_load", most_load, reduce=sustained),
    ]


def sustained(loads: Iterable[float]) -> float:
    """Largest mean of (n,) consecutive loads over 0.1 s; of a shorter episode, the mean."""
    values = np.array([*loads], float)
    if len(values) <= _SUSTAINED:
        return float(values.mean()) if len(values) else 0.0
    return float(np.convolve(values, np.full(_SUSTAINED, 1.0 / _SUSTAINED), "valid").max())


def make_task(name: str, params: Params, *, seed: int, root: Path) -> Task:
    """The task `body`; see `problems.registry`. Nothing in it depends on the seed."""
    if name != "body":
        raise UnknownNameError("task", name, ["body"])
    settings = params.tasks.body.problem
    policies = policies_of(settings, load_observations(root / RECORDED_FILE))
    codec: Codec = torque_synergies(policies, settings.body)
    knowledge = _knowledge(settings, policies)
    gains = ReflexGainsProblem(policies, settings.body)
    return Task(
        problem=policies,
        embedding=None,
        inputs=(RECORDED_FILE,),
        knowledge=knowledge,
        spaces={
            "torques": Task(policies, lambda initial: codec, knowledge=knowledge),
            "gains": Task(gains, None, knowledge=knowledge),
        },
    )


def policies_of(settings: BodyProblem, recorded: int | FloatArray = RECORDED_REFLEXES) -> GymnasiumPolicies:
    """The problem that the parameters describe; `recorded` as in `body_policies`."""
    return body_policies(
        settings.body,
        settings.pushes,
        horizon=settings.horizon,
        least_time=settings.least_time,
        most_load=settings.most_load,
        recorded=recorded,
    )


def save_observations(observations: FloatArray, path: Path) -> None:
    """Write (n, o) observations of an environment whose observations have single precision.

    Raises:
        WriteError: the file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, observations=np.asarray(observations, np.float32))


def load_observations(path: Path) -> FloatArray:
    """(n, o) what `save_observations` wrote.

    Raises:
        ProblemError: the file is missing or damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as kept:
            return np.asarray(kept["observations"], float)
    except (OSError, ValueError, KeyError, BadZipFile) as error:
        raise ProblemError(f"{path}: cannot be read: {error}; run the stage record_body") from error


def _knowledge(settings: BodyProblem, policies: GymnasiumPolicies) -> TaskKnowledge:
    """What the methods are given, in words."""
    joints = len(posture_of(settings.body).inertia)
    over_torques, all_weights = joints * (policies.policies.observations + 1), policies.policies.dimension
    return TaskKnowledge(
        latent_space=f"{over_torques:,} weights over {joints} joint-torque synergies, or the seven gains of "
        f"a reflex, for methods whose names say so; the others search all {all_weights:,} weights",
        kernel_features=f"the {len(policies.features.matrix)} main ways in which joint torques of 100 random "
        "reflexes differ over recorded observations",
        safety=", ".join(function.name for function in policies.safety),
        extra_trials=f"{RECORDED_REFLEXES} random reflexes, each played once per push, of which the "
        "observations are used",
    )
