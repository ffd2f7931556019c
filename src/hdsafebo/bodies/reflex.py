"""Stretch and balance reflexes: linear feedback from joints and centre of mass to muscles.

A stretch reflex makes each joint a spring and a damper; a balance reflex has ankles and hips push against
the centre of mass where it leaves the feet. Both ask for joint torques, which the least-norm muscle
excitations of `Posture` produce.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields

import numpy as np

from hdsafebo.bodies.model import load_body
from hdsafebo.bodies.posture import posture_of
from hdsafebo.errors import UnknownNameError
from hdsafebo.typing import FloatArray

_MOST_STIFFNESS = 600.0
"""N m/rad of one joint."""
_MOST_DAMPING = 60.0
"""N m s/rad of one joint."""
_SUBTALAR_SHARE = 0.2
"""Of a hip's sideways torque."""
_OFFSET = 4
"""The last four observations: offset and drift of the centre of mass, to the left and backwards."""


@dataclass(frozen=True)
class ReflexGains:
    """Seven numbers of a reflex.

    Attributes:
        stiffness: natural frequency of each joint's spring with the inertia that it moves, rad/s.
        damping: damping ratio of each joint.
        balance: torque of each ankle per offset of the centre of mass fore and aft, N m/m.
        balance_rate: the same per its velocity, in units of `balance`, s.
        sideways: torque of each hip per offset sideways, N m/m.
        sideways_rate: the same per its velocity, in units of `sideways`, s.
        lean: how far behind where it is in the posture the centre of mass is to be held, m.
    """

    stiffness: float
    damping: float
    balance: float
    balance_rate: float
    sideways: float
    sideways_rate: float
    lean: float

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Of the gains, in their order."""
        return tuple(f.name for f in fields(cls))


_RANGES = {
    "myofullbody": (
        ReflexGains(15.0, 0.6, 250.0, 0.1, -450.0, 0.2, -0.01),
        ReflexGains(40.0, 1.4, 900.0, 0.5, 450.0, 0.6, 0.02),
    ),
    "myolegs": (
        ReflexGains(15.0, 0.8, 1500.0, 0.3, -500.0, 0.2, -0.01),
        ReflexGains(60.0, 1.2, 4000.0, 0.8, 1200.0, 0.4, 0.01),
    ),
}
"""Gains with which some reflexes of each body stand for a while and others fall."""
_WIDER = 2.0
"""Factor by which a search over gains may leave their ranges."""


def gain_ranges(body: str) -> FloatArray:
    """(2, 7) least and largest gains of random reflexes, in the order of `ReflexGains.names`.

    Raises:
        UnknownNameError: there is no such body.
    """
    if body not in _RANGES:
        raise UnknownNameError("body", body, tuple(_RANGES))
    return np.array([astuple(limit) for limit in _RANGES[body]])


def gain_limits(body: str) -> FloatArray:
    """(2, 7) least and largest gains of a search, which may leave the ranges of random reflexes.

    Raises:
        UnknownNameError: there is no such body.
    """
    low, high = gain_ranges(body)
    further = (_WIDER - 1.0) * (high - low) / 2.0
    positive = low > 0
    return np.array(
        [
            np.where(positive, low / _WIDER, low - further),
            np.where(positive, high * _WIDER, high + further),
        ]
    )


def reflex(body: str, gains: ReflexGains) -> tuple[FloatArray, FloatArray]:
    """(muscles, 2 n + 10) excitations per observation and (muscles,) constant ones, beyond the posture's."""
    posture, joints = posture_of(body), load_body(body).joints
    n = len(joints)
    torques = np.zeros((n, 2 * n + 10))  # N m per observation
    rows = np.arange(n)
    stiffness = np.minimum(posture.inertia * gains.stiffness**2, _MOST_STIFFNESS)
    damping = np.minimum(2.0 * gains.damping * posture.inertia * gains.stiffness, _MOST_DAMPING)
    torques[rows, rows] = -stiffness
    torques[rows, n + rows] = -damping
    left, back, left_rate, back_rate = torques.shape[1] - _OFFSET + np.arange(_OFFSET)
    for side, sign in (("r", 1.0), ("l", -1.0)):
        ankle = joints.index(f"ankle_angle_{side}")
        torques[ankle, back] += gains.balance
        torques[ankle, back_rate] += gains.balance * gains.balance_rate
        for joint, share in (("hip_adduction", 1.0), ("subtalar_angle", _SUBTALAR_SHARE)):
            row = joints.index(f"{joint}_{side}")
            torques[row, left] += sign * share * gains.sideways
            torques[row, left_rate] += sign * share * gains.sideways * gains.sideways_rate
    per_observation = np.asarray(posture.excitation.T @ torques)
    return per_observation, -gains.lean * per_observation[:, back]


def random_gains(body: str, n: int, rng: np.random.Generator) -> list[ReflexGains]:
    """Gains of n random reflexes: log-uniform where they are positive, uniform where they may change sign."""
    low, high = gain_ranges(body)
    positive = low > 0
    share = rng.uniform(size=(n, len(low)))
    drawn = low + share * (high - low)
    drawn[:, positive] = low[positive] * (high[positive] / low[positive]) ** share[:, positive]
    return [ReflexGains(*row.tolist()) for row in drawn]
