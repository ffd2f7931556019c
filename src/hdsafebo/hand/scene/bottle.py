"""The bottle: a rigid capsule with a cap that shows which end is up."""

from __future__ import annotations

import mujoco

BOTTLE = "bottle"
BOTTLE_SHAPE = "bottle_body"
BOTTLE_WELD = "hold_bottle"

RADIUS = 0.03
"""m; radius, length and mass are those of a full half-litre plastic bottle."""
LENGTH = 0.21
"""m, from end to end."""
MASS = 0.5
"""kg, spread uniformly."""
FRICTION = (1.0, 0.01, 0.0005)
"""Sliding (-), torsional (m) and rolling (m) coefficients; the sliding one is that of MyoHand's skin."""


def add_bottle(spec: mujoco.MjSpec) -> None:
    """Add the free bottle, and an inactive weld that holds it in the air while the hand closes.

    The bottle's axis is the z axis of its body, the cap on the positive side. It touches the arm and
    nothing else, so every contact of the simulation is one between arm and bottle.
    """
    half = LENGTH / 2 - RADIUS
    body = spec.worldbody.add_body(name=BOTTLE, pos=[0.0, 0.0, 2.0])
    body.add_freejoint(name="bottle_free")
    body.add_geom(
        name=BOTTLE_SHAPE,
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[RADIUS, half, 0.0],
        mass=MASS,
        rgba=[0.2, 0.5, 0.9, 0.6],
        contype=0,
        conaffinity=1,
        condim=4,
        priority=1,  # the bottle's friction, not the larger of the two surfaces'
        friction=list(FRICTION),
        solref=[0.008, 1.0],
        solimp=[0.95, 0.99, 0.001, 0.5, 2.0],
    )
    body.add_geom(
        name="bottle_cap",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[RADIUS / 2, 0.012, 0.0],
        pos=[0.0, 0.0, LENGTH / 2 + 0.01],
        mass=0.0,
        rgba=[0.9, 0.2, 0.1, 1.0],
        contype=0,
        conaffinity=0,
    )
    weld = spec.add_equality(
        name=BOTTLE_WELD,
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1=BOTTLE,
        name2="world",
        active=False,
        solref=[0.004, 1.0],
    )
    data = [0.0] * len(weld.data)
    data[6] = data[10] = 1.0  # identity orientation and unit torque scale
    weld.data = data
