"""Adds the muscles and joints of `extension_table` to a MyoHand specification."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from hdsafebo.hand.scene.extension_table import (
    JOINTS,
    MUSCLES,
    OPPONENS_AREA,
    REATTACHED,
    SPECIFIC_TENSION,
    AddedMuscle,
    Point,
)

LENGTH_SAMPLES = 4000
_DAMPING = 0.05  # N m s/rad, as MyoHand's finger joints
_ARMATURE = 1e-4  # kg m2, as MyoHand's finger joints


def extend(spec: mujoco.MjSpec) -> None:
    """Edit a MyoHand in its zero pose: 12 more muscles and 5 more joints.

    Args:
        spec: MyoHand with its forearm muscles (43 muscles, 23 joints), root at the origin.
    """
    frames = _ZeroPose(spec)
    for site, body in REATTACHED.items():
        _reattach(spec, frames, site, body)
    for muscle in MUSCLES:
        _add_muscle(spec, frames, muscle)
    _set_force(spec.actuator("OP_r"), SPECIFIC_TENSION * OPPONENS_AREA)
    for joint in JOINTS:
        body = spec.body(joint.body)
        body.add_joint(
            name=joint.name,
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=frames.direction(joint.body, joint.axis),
            pos=[0.0, 0.0, 0.0] if joint.anchor is None else frames.point(joint.body, joint.anchor),
            range=list(joint.limits),
            limited=True,
            damping=_DAMPING,
            armature=_ARMATURE,
        )
    _set_length_ranges(spec, [f"{muscle.name}_r" for muscle in MUSCLES])


class _ZeroPose:
    """Converts points and directions of the zero pose to the frames of bodies."""

    def __init__(self, spec: mujoco.MjSpec) -> None:
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, self._data)

    def direction(self, body: str, vector: tuple[float, float, float]) -> NDArray[np.float64]:
        rotation = self._data.body(body).xmat.reshape(3, 3)
        return np.asarray(rotation.T @ np.asarray(vector))

    def site(self, name: str) -> tuple[float, float, float]:
        """Position of a site in the zero pose, m."""
        x, y, z = self._data.site(name).xpos
        return (x, y, z)

    def point(self, body: str, position: tuple[float, float, float]) -> NDArray[np.float64]:
        x, y, z = np.asarray(position) - self._data.body(body).xpos
        return self.direction(body, (x, y, z))


def _reattach(spec: mujoco.MjSpec, frames: _ZeroPose, name: str, body: str) -> None:
    """Let a site move with another body; its tendon finds it by name."""
    old = spec.site(name)
    size, group = old.size.copy(), old.group
    spec.delete(old)
    spec.body(body).add_site(name=name, pos=frames.point(body, frames.site(name)), size=size, group=group)


def _add_muscle(spec: mujoco.MjSpec, frames: _ZeroPose, muscle: AddedMuscle) -> None:
    """Tendon, sites and actuator of one muscle; a second head takes its share of force from its parent."""
    tendon = spec.add_tendon(name=f"{muscle.name}_tendon_r", width=0.002, rgba=[0.95, 0.3, 0.3, 1.0])
    for number, place in enumerate(muscle.path, start=1):
        if isinstance(place, Point):
            site = f"{muscle.name}-P{number}_r"
            spec.body(place.body).add_site(
                name=site, pos=frames.point(place.body, place.position), size=[0.001, 0, 0], group=3
            )
            tendon.wrap_site(site)
        else:
            tendon.wrap_site(place.site)
    if muscle.parent is not None:
        parent = spec.actuator(f"{muscle.parent}_r")
        whole = float(parent.gainprm[2])
        force = muscle.share * whole
        _set_force(parent, whole - force)
    else:
        assert muscle.area is not None
        force = SPECIFIC_TENSION * muscle.area
    actuator = spec.add_actuator(
        name=f"{muscle.name}_r", trntype=mujoco.mjtTrn.mjTRN_TENDON, target=tendon.name
    )
    # Activation dynamics and force-length-velocity curve of MyoHand's hand muscles.
    actuator.set_to_muscle(
        timeconst=[0.01, 0.04],
        tausmooth=0,
        range=[0.75, 1.05],
        force=force,
        scale=200,
        lmin=0.5,
        lmax=1.6,
        vmax=1.5,
        fpmax=1.3,
        fvmax=1.2,
    )
    actuator.ctrllimited = True
    actuator.ctrlrange = [0.0, 1.0]


def _set_force(actuator: mujoco.MjsActuator, force: float) -> None:
    """Maximal isometric force, N, of the active and of the passive part."""
    actuator.gainprm[2] = force
    actuator.biasprm[2] = force


def _set_length_ranges(spec: mujoco.MjSpec, muscles: list[str]) -> None:
    """Shortest and longest tendon path over the joint ranges, by uniform sampling with a fixed seed.

    MuJoCo's own search pulls each muscle in a simulation without the others, which lets it leave the
    range that the hand can reach.
    """
    for name in muscles:
        spec.actuator(name).lengthrange = [0.01, 1.0]  # keeps the compiler from searching
    model = spec.compile()
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    lower, upper = model.jnt_range.T
    tendons = [model.actuator(name).trnid[0] for name in muscles]
    lengths = np.empty((LENGTH_SAMPLES, len(muscles)))
    for row in range(LENGTH_SAMPLES):
        data.qpos[:] = rng.uniform(lower, upper)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        lengths[row] = data.ten_length[tendons]
    for name, shortest, longest in zip(muscles, lengths.min(0), lengths.max(0), strict=True):
        spec.actuator(name).lengthrange = [shortest, longest]
