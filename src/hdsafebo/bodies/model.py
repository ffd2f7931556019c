"""Standing bodies of the package `myo-sim`, as compiled MuJoCo models.

`myofullbody` has 416 Hill-type muscles and 123 joints, `myolegs` 80 muscles on the same legs. The arms of the
whole body derive from MoBL-ARMS (Saul et al., Comput Methods Biomech Biomed Engin 18:1445-1458, 2015), whose
authors permit non-commercial use.
"""

from __future__ import annotations

import logging
import threading
import warnings
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np

from hdsafebo.errors import UnknownNameError
from hdsafebo.typing import FloatArray, IntArray

BODIES = ("myofullbody", "myolegs")
TIMESTEP = 0.002
"""s; Euler steps. Larger ones change when a body falls."""
FEET = ("calcn_r", "calcn_l", "toes_r", "toes_l")
PELVIS = "pelvis"
_UP = np.array([0.0, 0.0, 1.0])

_HARMLESS = "Attaching a spec with an empty prefix"
"""Of saving a model as XML, which nobody does here."""

_log = logging.getLogger(__name__)
_loading = threading.Lock()


@dataclass(frozen=True)
class Body:
    """A compiled body and what is known of the posture that it starts in.

    Attributes:
        name: of the model.
        mj: the MuJoCo model; its first keyframe is the posture.
        muscles: names, in the order of excitations.
        joints: names of the n joints that no coupling determines, in the order of angles.
        joint_ids: (n,) numbers of these joints.
        angles: (n,) their places in qpos.
        speeds: (n,) their places in qvel.
        posture: (nq,) positions of the posture.
        pelvis: number of the pelvis.
        feet: (4,) numbers of heels and toes.
        root: number of the body that carries all others.
        height: of the pelvis in the posture, m.
        upright: (3,) vector that points up in the posture, in the pelvis' own axes.
        mass: kg.
    """

    name: str
    mj: mujoco.MjModel
    muscles: tuple[str, ...]
    joints: tuple[str, ...]
    joint_ids: IntArray
    angles: IntArray
    speeds: IntArray
    posture: FloatArray
    pelvis: int
    feet: IntArray
    root: int
    height: float
    upright: FloatArray
    mass: float

    def start(self, data: mujoco.MjData) -> None:
        """Put a simulation into the posture, at rest and with muscles at rest."""
        mujoco.mj_resetDataKeyframe(self.mj, data, 0)
        mujoco.mj_forward(self.mj, data)


@lru_cache(maxsize=2)
def load_body(name: str = "myofullbody") -> Body:
    """Compile a body (2 s for the whole one; later calls share one model).

    Raises:
        UnknownNameError: there is no such body.
    """
    if name not in BODIES:
        raise UnknownNameError("body", name, BODIES)
    model = _compiled(name)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    coupled = {
        int(model.eq_obj1id[i]) for i in range(model.neq) if model.eq_type[i] == mujoco.mjtEq.mjEQ_JOINT
    }
    free = mujoco.mjtJoint.mjJNT_FREE
    joints = np.array([j for j in range(model.njnt) if model.jnt_type[j] != free and j not in coupled])
    pelvis = model.body(PELVIS).id
    return Body(
        name=name,
        mj=model,
        muscles=tuple(model.actuator(i).name for i in range(model.nu)),
        joints=tuple(model.joint(j).name for j in joints),
        joint_ids=joints,
        angles=model.jnt_qposadr[joints],
        speeds=model.jnt_dofadr[joints],
        posture=data.qpos.copy(),
        pelvis=pelvis,
        feet=np.array([model.body(foot).id for foot in FEET]),
        root=int(model.jnt_bodyid[0]),
        height=float(data.xpos[pelvis, 2]),
        upright=data.xmat[pelvis].reshape(3, 3).T @ _UP,
        mass=float(model.body_mass.sum()),
    )


def _compiled(name: str) -> mujoco.MjModel:
    import myo_sim

    mujoco.set_mju_user_warning(_warn)  # else MuJoCo writes MUJOCO_LOG.TXT into the working directory
    with _loading, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=_HARMLESS)
        model = myo_sim.load_model(name)
    model.opt.timestep = TIMESTEP
    return model


def _warn(text: str) -> None:
    """MuJoCo's warnings go to the log."""
    _log.log(logging.DEBUG if text.startswith(_HARMLESS) else logging.WARNING, text)
