"""Reflexes as policies: the initial design of a standing body, and their seven gains to search.

The gains are what a careful person would tune by hand. A search over them alone is the control for a search
over all weights.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from hdsafebo.bodies.posture import posture_of
from hdsafebo.bodies.reflex import ReflexGains, gain_limits, random_gains, reflex
from hdsafebo.policies import GymnasiumPolicies
from hdsafebo.policies.affine import PolicySpace
from hdsafebo.problem import Problem, check_problem
from hdsafebo.trials import Evaluation, Trials
from hdsafebo.typing import FloatArray, IntArray

EXCITATION_UNIT = 2.0
"""Actions span [-1, 1] and excitations [0, 1]: with it, weights are in units of excitation."""


@dataclass(frozen=True)
class ReflexDesign:
    """Draws reflexes with random gains; see `bodies.reflex`.

    Attributes:
        body: name of the body.
    """

    body: str

    def __call__(self, space: PolicySpace, n: int, rng: np.random.Generator) -> FloatArray:
        """(n, D) weights of n reflexes about the excitations that hold the posture."""
        return np.stack([reflex_weights(space, self.body, one) for one in random_gains(self.body, n, rng)])


class ReflexGainsProblem(Problem):
    """The seven gains of a reflex in place of all weights: what a careful person would tune.

    Args:
        policies: the problem of the body, which plays and judges.
        body: its name.
    """

    depends_on_history = False

    def __init__(self, policies: GymnasiumPolicies, body: str = "myofullbody") -> None:
        self.policies, self.body = policies, body
        self.name = f"{policies.name}_gains"
        self.safety = policies.safety
        self.bounds = gain_limits(body)
        check_problem(self)

    def evaluate(self, trials: Trials) -> Evaluation:
        """Play the reflexes with the gains of each row."""
        x = np.stack([self.weights(row) for row in trials.x])
        return self.policies.evaluate(Trials.pending(x, x, len(self.safety)))

    def initial(self, n: int, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
        """n random reflexes, drawn as those of the initial design of all weights."""
        gains = random_gains(self.body, n, rng)
        return np.array([astuple(one) for one in gains]), np.full(n, -1)

    def weights(self, gains: FloatArray) -> FloatArray:
        """(D,) weights of the reflex with (7,) gains."""
        given = ReflexGains(*np.asarray(gains, float).tolist())
        return reflex_weights(self.policies.policies, self.body, given)


def reflex_weights(space: PolicySpace, body: str, gains: ReflexGains) -> FloatArray:
    """(D,) weights of a reflex about the excitations that hold the posture."""
    per_observation, constant = reflex(body, gains)
    return space.weights_of(EXCITATION_UNIT * per_observation, as_action(posture_of(body).holding + constant))


def as_action(excitation: FloatArray) -> FloatArray:
    """Excitations in [0, 1] as actions in [-1, 1]."""
    return EXCITATION_UNIT * excitation - 1.0
