"""What a policy sees: joints, bottle, and the bottle relative to the palm.

The extended hand gives 65 numbers, as many as the paper's: 28 joint angles, 19 joint velocities (the
interphalangeal ones follow the knuckles in a grasp and are left out) and 18 numbers about the bottle.
Neither activations nor time are seen. Scales bring the entries to the order of one.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import UnknownNameError
from hdsafebo.hand.scene.bottle import BOTTLE
from hdsafebo.hand.scene.model import PALM_BODIES, HandModel
from hdsafebo.typing import FloatArray

CONTROL_INTERVAL = 0.02
"""s between decisions of the policy; joint velocities are seen as angle per interval."""

_POSITION, _VELOCITY, _SPIN = 5.0, 0.2, 0.05  # per m, s/m, s
_BOTTLE_PARTS = (
    ("displacement", 3),
    ("velocity", 3),
    ("spin", 3),
    ("axis", 3),
    ("righting", 2),
    ("from_palm", 3),
    ("constant", 1),
)
_INTERPHALANGEAL = ("ip_", "pm", "md")

SETTINGS: Mapping[str, tuple[str, ...]] = {
    "full": ("angle", "joint_velocity", *(name for name, _ in _BOTTLE_PARTS)),
    "posture": ("angle", "displacement", "axis", "righting", "from_palm", "constant"),
    "bottle": tuple(name for name, _ in _BOTTLE_PARTS),
    "touch": ("angle", "joint_velocity", "from_palm", "constant"),
}
"""Which parts an agent in training sees (the "different observation setting" of the paper's appendix)."""


class Observer:
    """Computes the observation of a simulation.

    Attributes:
        parts: name of each part and the slice of the vector that holds it.
        size: length of the vector.
    """

    def __init__(self, hand: HandModel, model: mujoco.MjModel, start: FloatArray) -> None:
        self._joints = len(hand.joints)
        self._moving = np.array(
            [i for i, name in enumerate(hand.joints) if not name.startswith(_INTERPHALANGEAL)]
        )
        self._bottle = model.body(BOTTLE).id
        self._palm = [model.body(name).id for name in PALM_BODIES]
        self._start = start.copy()
        lengths = (("angle", self._joints), ("joint_velocity", len(self._moving)), *_BOTTLE_PARTS)
        self.parts: dict[str, slice] = {}
        end = 0
        for name, length in lengths:
            self.parts[name] = slice(end, end + length)
            end += length
        self.size = end

    def columns(self, setting: str) -> NDArray[np.int64]:
        """Entries of the vector that a setting shows.

        Raises:
            UnknownNameError: no such setting.
        """
        if setting not in SETTINGS:
            raise UnknownNameError("observation setting", setting, tuple(SETTINGS))
        entries = np.arange(self.size)
        return np.concatenate([entries[self.parts[name]] for name in SETTINGS[setting]])

    def observe(self, data: mujoco.MjData) -> FloatArray:
        """(size,) the observation; joint angles in rad, the rest scaled."""
        position = data.xpos[self._bottle]
        rotation = data.xmat[self._bottle].reshape(3, 3)
        axis = rotation[:, 2]
        return np.concatenate(
            [
                data.qpos[: self._joints],
                data.qvel[self._moving] * CONTROL_INTERVAL,
                (position - self._start) * _POSITION,
                data.qvel[-6:-3] * _VELOCITY,
                rotation @ data.qvel[-3:] * _SPIN,
                axis,
                righting_rotation(axis),
                (position - self.palm(data)) * _POSITION,
                [1.0],
            ]
        )

    def palm(self, data: mujoco.MjData) -> FloatArray:
        """(3,) mean position of metacarpals and finger bases, m."""
        return np.asarray(data.xpos[self._palm].mean(axis=0))


def tilt(axis: FloatArray) -> float:
    """Angle between the bottle's axis and the vertical, rad; 0 is upright, cap up."""
    return float(np.arctan2(np.hypot(axis[0], axis[1]), axis[2]))


def righting_rotation(axis: FloatArray) -> FloatArray:
    """(2,) horizontal rotation vector, rad, that would right the axis; zero where the axis points down."""
    horizontal = np.hypot(axis[0], axis[1])
    if horizontal < 1e-9:
        return np.zeros(2)
    return np.array([axis[1], -axis[0]]) * (tilt(axis) / horizontal)
