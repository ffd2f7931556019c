"""The start of an episode: the bottle lies across the fingers of the upturned hand, gripped lightly.

The pose is found by code, since every edit of the model moves it: the bottle is welded in the air above
the bases of the fingers, the finger flexors close the hand at a weak activation, the weld is released,
and the grip settles. Candidates are tried in a fixed order until one passes the checks.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import HandModelError
from hdsafebo.hand.scene.bottle import BOTTLE, BOTTLE_WELD
from hdsafebo.hand.scene.model import ARM_ROOT, HandModel

BOTTLE_HEIGHT = 1.39
"""m; a free fall from here to 0.4 m ends at 4.41 m/s, near the paper's threshold of 4.4."""

MAX_PENETRATION = 1e-3
MIN_CONTACTS = 3
MAX_BOTTLE_SPEED = 0.3
FLEXORS = ("FDS", "FDP", "LU_RB", "UI_UB")
PALM_ANGLE = -1.4
"""rad from thumb up to palm up; -pi/2 is palm up."""

_CLOSING_S, _SETTLING_S = 0.6, 0.1
_THUMB_ASIDE = {"cmc_flexion": -0.065, "cmc_abduction": -0.277}
_OFFSETS = (
    (-0.024, -0.001, 0.049),
    (-0.020, -0.001, 0.047),
    (-0.028, -0.001, 0.051),
    (-0.016, -0.001, 0.046),
)
_ACTIVATIONS = (0.06, 0.04, 0.08, 0.02)


@dataclass(frozen=True)
class StartPose:
    """A checked start.

    Attributes:
        qpos: joint angles, rad, and the bottle's position, m, and quaternion.
        activation: (muscles,) activations that hold it.
        arm_height: height of the arm's root, m, that puts the bottle at `BOTTLE_HEIGHT`.
        penetration: deepest overlap of bottle and hand, m.
        contacts: number of contact points.
    """

    qpos: NDArray[np.float64]
    activation: NDArray[np.float64]
    arm_height: float
    penetration: float
    contacts: int


_found: dict[str, StartPose] = {}


def start_pose(hand: HandModel) -> StartPose:
    """The start pose of a hand; found once per process for each model digest (0.2 s).

    Raises:
        HandModelError: no candidate holds the bottle.
    """
    if hand.digest not in _found:
        _found[hand.digest] = _search(hand)
    return _found[hand.digest]


def _search(hand: HandModel) -> StartPose:
    """The first candidate that passes the checks."""
    faults = []
    for offset, activation in candidates():
        pose = _close_hand(hand, offset, activation)
        fault = check_start_pose(hand, pose)
        if fault is None:
            return pose
        faults.append(f"offset {offset}, activation {activation}: {fault}")
    raise HandModelError(
        f"no start pose holds the bottle in the hand {hand.variant!r}, roll {hand.roll}: " + "; ".join(faults)
    )


def candidates() -> Iterator[tuple[tuple[float, float, float], float]]:
    """Offsets of the bottle from the base of the middle finger (m) and flexor activations, best first."""
    return product(_OFFSETS, _ACTIVATIONS)


def placed_model(hand: HandModel, pose: StartPose) -> mujoco.MjModel:
    """A copy of the hand's model with the arm at the height of the pose."""
    model = copy.copy(hand.mj)
    model.body(ARM_ROOT).pos[2] = pose.arm_height
    return model


def reset(model: mujoco.MjModel, data: mujoco.MjData, pose: StartPose) -> None:
    """Put a simulation into the start pose, at rest."""
    mujoco.mj_resetData(model, data)
    data.qpos[:] = pose.qpos
    data.act[:] = pose.activation
    data.ctrl[:] = pose.activation
    mujoco.mj_forward(model, data)


def check_start_pose(hand: HandModel, pose: StartPose) -> str | None:
    """What is wrong with a start pose, or None.

    The bottle must touch the hand in at least `MIN_CONTACTS` points and overlap it by less than
    `MAX_PENETRATION`; with the activations kept for another 0.1 s it must still be held, slower than
    `MAX_BOTTLE_SPEED`.
    """
    model = placed_model(hand, pose)
    data = mujoco.MjData(model)
    reset(model, data, pose)
    if not (np.isfinite(data.qpos).all() and np.isfinite(data.qacc).all()):
        return "not finite"
    if data.ncon < MIN_CONTACTS:
        return f"{data.ncon} contact points; expected at least {MIN_CONTACTS}"
    depth = -float(data.contact.dist.min())
    if depth >= MAX_PENETRATION:
        return (
            f"bottle and hand overlap by {1e3 * depth:.2f} mm; expected less than {1e3 * MAX_PENETRATION} mm"
        )
    mujoco.mj_step(model, data, nstep=round(0.1 / model.opt.timestep))
    speed = float(np.linalg.norm(data.qvel[-6:-3]))
    if data.ncon == 0 or speed > MAX_BOTTLE_SPEED:
        return f"not held: {data.ncon} contacts, {speed:.2f} m/s; expected at most {MAX_BOTTLE_SPEED}"
    return None


def _close_hand(hand: HandModel, offset: tuple[float, float, float], activation: float) -> StartPose:
    """Simulate closing the hand around the bottle; forearm and wrist are kept where they are."""
    model = copy.copy(hand.mj)
    data = mujoco.MjData(model)
    kept = {"pro_sup": PALM_ANGLE + hand.roll, "deviation": 0.1, "flexion": 0.0}
    for name, angle in (kept | _THUMB_ASIDE).items():
        data.joint(f"{name}_r").qpos = angle
    mujoco.mj_forward(model, data)
    bottle = np.concatenate(
        [data.body("3proxph_r").xpos + np.array(offset), [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]]
    )
    data.qpos[-7:] = bottle
    weld = model.equality(BOTTLE_WELD).id
    model.eq_data[weld, :11] = np.concatenate([np.zeros(3), _world_in_frame(bottle), [1.0]])
    data.eq_active[weld] = 1
    for index, name in enumerate(hand.muscles):
        if name.startswith(FLEXORS):
            data.ctrl[index] = activation
    closing, settling = round(_CLOSING_S / model.opt.timestep), round(_SETTLING_S / model.opt.timestep)
    for step in range(closing + settling):
        if step == closing:
            data.eq_active[weld] = 0
        for name, angle in kept.items():
            data.joint(f"{name}_r").qpos = angle
            data.joint(f"{name}_r").qvel = 0.0
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    rise = BOTTLE_HEIGHT - float(data.body(BOTTLE).xpos[2])
    qpos = data.qpos.copy()
    qpos[-5] += rise
    penetration = max(0.0, -float(data.contact.dist.min())) if data.ncon else 0.0
    return StartPose(
        qpos, data.act.copy(), float(model.body(ARM_ROOT).pos[2]) + rise, penetration, int(data.ncon)
    )


def _world_in_frame(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Position and quaternion of the world seen from a frame with the given position and quaternion."""
    position, quaternion = np.zeros(3), np.zeros(4)
    mujoco.mju_negPose(position, quaternion, pose[:3], pose[3:])
    return np.concatenate([position, quaternion])
