"""Staying up after a push with a whole body: linear policies over all muscles, safe from the first trial on.

Objective: mean return over fixed pushes. Safety functions, the least of the pushes:

* `stands`: how much longer the body stays up than 1.7 s, as a share of the episode;
* `joint_load`: how far the largest torque of joint stops and couplings stays below 80 N m.

Both are computed from the episode alone. Initial policies are stretch and balance reflexes with random gains
about the muscle excitations that hold the posture; a third of them is unsafe, and none stands for 5 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from hdsafebo.bodies.environment import HORIZON
from hdsafebo.bodies.posture import posture_of
from hdsafebo.bodies.reflex import ReflexGains, gain_ranges, random_gains, reflex
from hdsafebo.bodies.simulation import CONTROL_INTERVAL
from hdsafebo.policies import GymnasiumPolicies
from hdsafebo.policies.affine import PolicySpace
from hdsafebo.policies.safety import EpisodeSafety, budget, lasts
from hdsafebo.policies.synergies import ActionSynergies
from hdsafebo.problem import Problem, check_problem
from hdsafebo.trials import Evaluation, Trials
from hdsafebo.typing import FloatArray

PUSHES = (1, 4, 9)
"""Seeds of the evaluation pushes: forwards to the right, forwards, forwards to the left; 0.09 to 0.17 m/s."""
UNSEEN_PUSHES = (101, 102, 103, 104, 105)
"""Seeds of pushes that no trial meets."""
LEAST_TIME = 1.7
"""s."""
MOST_LOAD = 80.0
"""N m."""
ENVIRONMENTS = {"myofullbody": "hdsafebo/PushedBody-v0", "myolegs": "hdsafebo/PushedLegs-v0"}
_DIRECTIONS = 8
_EXCITATION_UNIT = 2.0
"""Actions span [-1, 1] and excitations [0, 1]: with it, weights are in units of excitation."""
_TONE_SPREAD = 0.2
"""Of the logarithm of the excitations about which random reflexes act."""
_JITTER = 0.01


@dataclass(frozen=True)
class ReflexDesign:
    """Draws reflexes with random gains; see `bodies.reflex`.

    Attributes:
        body: name of the body.
    """

    body: str

    def __call__(self, space: PolicySpace, n: int, rng: np.random.Generator) -> FloatArray:
        """(n, D) weights of n reflexes, with a little noise in every weight."""
        return np.stack([self._one(space, rng) for _ in range(n)])

    def _one(self, space: PolicySpace, rng: np.random.Generator) -> FloatArray:
        [gains] = random_gains(self.body, 1, rng)
        holding = posture_of(self.body).holding
        tone = holding * np.exp(_TONE_SPREAD * rng.standard_normal(len(holding)))
        weights = space.weights_of(_EXCITATION_UNIT * reflex(self.body, gains), _as_action(tone))
        columns = space.observations + 1
        return weights + _JITTER / np.sqrt(columns) * rng.standard_normal(len(weights))


def body_policies(
    body: str = "myofullbody",
    pushes: Sequence[int] = PUSHES,
    *,
    horizon: int = HORIZON,
    least_time: float = LEAST_TIME,
    most_load: float = MOST_LOAD,
    executor: Executor | None = None,
) -> GymnasiumPolicies:
    """The problem of a body that stays up.

    Args:
        body: `myofullbody` or `myolegs`.
        pushes: seeds of the pushes that every trial meets.
        horizon: control steps of 10 ms.
        least_time: that the body must stay up, s.
        most_load: torque of joint stops and couplings that it must stay below, N m.
        executor: see `GymnasiumPolicies`.
    """
    return GymnasiumPolicies(
        ENVIRONMENTS[body],
        safety_functions(least_time, most_load),
        seeds=pushes,
        horizon=horizon,
        arguments={"horizon": horizon},
        base=_as_action(posture_of(body).holding),
        unit=_EXCITATION_UNIT,
        design=ReflexDesign(body),
        box="design",
        directions=_DIRECTIONS,
        action_directions=_DIRECTIONS,
        recorded=8,
        name=f"body_{body}",
        executor=executor,
    )


class ReflexGainsProblem(Problem):
    """The six gains of a reflex in place of all weights: what a careful person would tune.

    Args:
        policies: the problem of the body, which plays and judges.
        body: its name.
    """

    depends_on_history = False

    def __init__(self, policies: GymnasiumPolicies, body: str = "myofullbody") -> None:
        self.policies, self.body = policies, body
        self.name = f"{policies.name}_gains"
        self.safety = policies.safety
        self.bounds = gain_ranges(body)
        check_problem(self)

    def evaluate(self, trials: Trials) -> Evaluation:
        """Play the reflexes with the gains of each row."""
        x = np.stack([self.weights(row) for row in trials.x])
        return self.policies.evaluate(Trials.pending(x, x, len(self.safety)))

    def weights(self, gains: FloatArray) -> FloatArray:
        """(D,) weights of the reflex with (6,) gains, about the excitations that hold the posture."""
        gain = _EXCITATION_UNIT * reflex(self.body, ReflexGains(*np.asarray(gains, float).tolist()))
        return self.policies.policies.weights_of(gain, _as_action(posture_of(self.body).holding))


def torque_synergies(policies: GymnasiumPolicies, body: str = "myofullbody") -> ActionSynergies:
    """Policies whose muscles act together as joint torques need: one synergy per independent joint."""
    return policies.synergies(posture_of(body).excitation)


def safety_functions(least_time: float, most_load: float) -> list[EpisodeSafety]:
    """Those of the task, in physical units: seconds and N m."""
    return [
        lasts(round(least_time / CONTROL_INTERVAL), name="stands"),
        budget("joint_load", most_load, reduce=max),
    ]


def _as_action(excitation: FloatArray) -> FloatArray:
    """Excitations in [0, 1] as actions in [-1, 1]."""
    return _EXCITATION_UNIT * excitation - 1.0
