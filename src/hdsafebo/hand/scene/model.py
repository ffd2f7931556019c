"""The musculoskeletal hand with its bottle, as a compiled MuJoCo model.

Bones, joints and muscles are those of MyoHand (package `myo-sim`, Apache-2.0), derived from Holzbaur et
al., Ann Biomed Eng 33:829-840, 2005, and Lee et al., PLoS ONE 10:e0121712, 2015. The arm stays fixed in
space; forearm rotation, wrist and hand move.
"""

from __future__ import annotations

import hashlib
import logging
import threading
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

import mujoco
import numpy as np
from myo_sim.build import compose
from myo_sim.build import hand as myo_hand

from hdsafebo.errors import HandModelError, UnknownNameError
from hdsafebo.hand.scene.bottle import add_bottle
from hdsafebo.hand.scene.extension import extend

Variant = Literal["forearm", "extended"]
"""`forearm`: 43 muscles, 23 joints. `extended`: 55 muscles, 28 joints, as many as the paper's hand."""

FOREARM_MUSCLES = frozenset({"SUP", "BIClong", "BICshort", "BRD"})
FOREARM_BODIES = ("humerus_r", "ulna_r", "radius_r")
PALM_BODIES = tuple(f"{mc}_r" for mc in ("secondmc", "thirdmc", "fourthmc", "fifthmc")) + tuple(
    f"{k}proxph_r" for k in (2, 3, 4, 5)
)
ARM_ROOT = "myoarm_r_root"
FOREARM_SHAPES = ("ulna_coll_r", "radius_coll_r", "radius_coll_2_r", "radius_coll_3_r")
CONTACT_GROUP = 4
TIMESTEP = 0.002
MAX_ROLL = 1.57

_log = logging.getLogger(__name__)
_myo_sim_lock = threading.Lock()


@dataclass(frozen=True)
class HandModel:
    """A compiled hand and what the other modules need to know about it.

    Attributes:
        variant: which hand.
        roll: rotation of the fixed upper arm about the forearm's axis, rad.
        mj: the MuJoCo model; its arm's height is set by the start pose.
        muscles: names of the muscles, without side, in the order of activations.
        joints: names of the hinges, without side, in the order of joint angles.
        digest: SHA-256 of the compiled model's numbers: the same for the same hand, and for no other.
    """

    variant: str
    roll: float
    mj: mujoco.MjModel
    muscles: tuple[str, ...]
    joints: tuple[str, ...]
    digest: str


@lru_cache(maxsize=4)
def hand_model(variant: Variant = "extended", roll: float = 1.4) -> HandModel:
    """Build a hand with its bottle (0.5 s; later calls with the same arguments share one model).

    Args:
        variant: which muscles and joints.
        roll: rotation of the upper arm, rad; the further the arm is rolled, the nearer an upright
            bottle is to the end of the range of pronation.

    Raises:
        UnknownNameError: no such variant.
        HandModelError: `roll` is out of range.
    """
    if variant not in get_args(Variant):
        raise UnknownNameError("hand variant", variant, get_args(Variant))
    if not 0.0 <= roll <= MAX_ROLL:
        raise HandModelError(f"roll is {roll} rad; expected 0 to {MAX_ROLL}")
    mujoco.set_mju_user_warning(
        _log.warning
    )  # otherwise MuJoCo writes MUJOCO_LOG.TXT into the working directory
    spec = _myo_hand()
    if variant == "extended":
        extend(spec)
    _shape_heel(spec)
    _place_arm(spec, roll)
    add_bottle(spec)
    _set_physics(spec)
    model = spec.compile()
    return HandModel(
        variant=variant,
        roll=roll,
        mj=model,
        muscles=tuple(model.actuator(i).name.removesuffix("_r") for i in range(model.nu)),
        joints=tuple(
            model.joint(i).name.removesuffix("_r")
            for i in range(model.njnt)
            if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE
        ),
        digest=_digest(model),
    )


def _myo_hand() -> mujoco.MjSpec:
    """MyoHand with the forearm muscles that its pruning drops: SUP, both heads of BIC, and BRD.

    `myo_sim` reads the muscles to keep from a module constant; it is put back at once.
    """
    with _myo_sim_lock:
        kept = myo_hand.RIGHT_HAND_ACTUATORS
        try:
            myo_hand.RIGHT_HAND_ACTUATORS = kept | FOREARM_MUSCLES
            return compose.build_right_hand_from_arm_spec()
        finally:
            myo_hand.RIGHT_HAND_ACTUATORS = kept


HEEL_RADIUS = 0.012
HEEL = (
    ((0.530, 0.020, 0.163), (0.545, 0.020, 0.163)),
    ((0.530, 0.002, 0.163), (0.545, -0.002, 0.163)),
)
"""Axes (m, zero pose: x distal, y radial, z dorsal) of two capsules under the carpus. Placed by eye."""


def _shape_heel(spec: mujoco.MjSpec) -> None:
    """Let the bottle touch the heel of the hand, and nothing above the wrist.

    MyoHand has no contact shapes between metacarpals and forearm, where the eminences of thumb and little
    finger are; two capsules stand in for them. Its forearm shapes do touch things, so a bottle can be wedged
    into the bent wrist without being held; here they touch nothing (`BottleSimulation` watches for overlap).
    """
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    carpus = data.body("capitate_r")
    for number, axis in enumerate(HEEL):
        ends = (np.array(axis) - carpus.xpos) @ carpus.xmat.reshape(3, 3)
        spec.body("capitate_r").add_geom(
            name=f"heel{number}_coll_r",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=ends.ravel(),
            size=[HEEL_RADIUS, 0.0, 0.0],
            mass=0.0,
            contype=1,
            conaffinity=0,
            group=CONTACT_GROUP,
        )
    for geom in spec.geoms:
        if geom.contype and geom.parent.name in FOREARM_BODIES:
            geom.contype = 0


def _place_arm(spec: mujoco.MjSpec, roll: float) -> None:
    """Forearm horizontal along x, rotated by 90 degrees plus `roll` about it."""
    angle = np.pi / 2 + roll
    root = spec.body(ARM_ROOT)
    root.pos = [-0.6, 0.0, 1.4]
    root.quat = [np.cos(angle / 2), np.sin(angle / 2), 0.0, 0.0]


def _set_physics(spec: mujoco.MjSpec) -> None:
    """Integration and contact settings, and light and image size for pictures."""
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 3.0  # firmer friction: a held bottle does not creep
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.95, 0.96, 0.98],
        rgb2=[0.75, 0.80, 0.86],
        width=64,
        height=64,
    )
    spec.worldbody.add_light(
        pos=[0.5, -1.0, 3.0], dir=[-0.2, 0.3, -1.0], diffuse=[0.8] * 3, ambient=[0.3] * 3
    )
    spec.visual.global_.offwidth = 1280
    spec.visual.global_.offheight = 960
    spec.visual.quality.offsamples = 0  # smoothing doubles the time of pictures drawn without a GPU


_DIGESTED = (
    "actuator_gainprm", "actuator_biasprm", "actuator_dynprm", "actuator_lengthrange", "actuator_trnid",
    "body_pos", "body_quat", "body_mass", "body_inertia", "body_ipos", "body_iquat", "body_parentid",
    "jnt_axis", "jnt_pos", "jnt_range", "jnt_bodyid", "jnt_type", "dof_damping", "dof_armature",
    "geom_size", "geom_pos", "geom_quat", "geom_contype", "geom_conaffinity",
    "geom_friction", "geom_solref", "geom_solimp",
    "site_pos", "site_bodyid", "wrap_objid", "wrap_type", "wrap_prm", "tendon_adr", "tendon_num", "names",
)  # fmt: skip


def _digest(model: mujoco.MjModel) -> str:
    """SHA-256 over the arrays that decide the motion, and over MuJoCo's version."""
    sha = hashlib.sha256(mujoco.__version__.encode())
    sha.update(
        repr(
            (model.opt.timestep, int(model.opt.integrator), int(model.opt.cone), model.opt.impratio)
        ).encode()
    )
    for name in _DIGESTED:
        value = getattr(model, name)
        sha.update(name.encode())
        sha.update(value if isinstance(value, bytes) else np.ascontiguousarray(value).tobytes())
    return sha.hexdigest()
