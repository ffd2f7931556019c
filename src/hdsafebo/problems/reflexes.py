"""Reflexes as policies: the initial design of a standing body, and their six gains to search.

The gains are what a careful person would tune by hand. A search over them alone is the control for a search
over all weights.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from hdsafebo.bodies.posture import posture_of
from hdsafebo.bodies.reflex import ReflexGains, gain_ranges, random_gains, reflex
from hdsafebo.policies import GymnasiumPolicies
from hdsafebo.policies.affine import PolicySpace
from hdsafebo.problem import Problem, check_problem
from hdsafebo.trials import Evaluation, Trials
from hdsafebo.typing import FloatArray, IntArray

EXCITATION_UNIT = 2.0
"""Actions span [-1, 1] and excitations [0, 1]: with it, weights are in units of excitation."""
_TONE_SPREAD = 0.2
"""Of the logarithm of the excitations about which random reflexes act."""
_JITTER = 0.01
"""Length of the random weights of a muscle, so that policies differ in every weight."""


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
        weights = space.weights_of(EXCITATION_UNIT * reflex(self.body, gains), as_action(tone))
        columns = space.observations + 1
        return weights + _JITTER / np.sqrt(columns) * rng.standard_normal(len(weights))


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

    def initial(self, n: int, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
        """n random reflexes, drawn as those of the initial design of all weights."""
        gains = random_gains(self.body, n, rng)
        return np.array([astuple(one) for one in gains]), np.full(n, -1)

    def weights(self, gains: FloatArray) -> FloatArray:
        """(D,) weights of the reflex with (6,) gains, about the excitations that hold the posture."""
        gain = EXCITATION_UNIT * reflex(self.body, ReflexGains(*np.asarray(gains, float).tolist()))
        return self.policies.policies.weights_of(gain, as_action(posture_of(self.body).holding))


def as_action(excitation: FloatArray) -> FloatArray:
    """Excitations in [0, 1] as actions in [-1, 1]."""
    return EXCITATION_UNIT * excitation - 1.0
