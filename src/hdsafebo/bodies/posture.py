"""A body linearised at its posture: how joints are coupled, what muscles do, what gravity asks of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from scipy.optimize import lsq_linear

from hdsafebo.bodies.model import Body, load_body
from hdsafebo.threads import one_thread
from hdsafebo.typing import FloatArray

GRAVITY = 9.81
_RIDGE = 1e-3
"""Of the least-norm muscle excitations per torque, in units of each joint's own torque squared."""
_REST = 0.03
_REST_WEIGHT = 0.02
"""Excitations that gravity does not determine tend to 0.03, the tone of a resting muscle."""
_LEAST_TORQUE = 1.0  # N m; joints that no muscle moves would otherwise outweigh all others
_LEAST_SQUARE = 1e-3  # (N m)^2, for the same reason
_LEAST_INERTIA = 1e-3  # kg m^2; less is an armature's rounding
_HEELS = ("calcn_r", "calcn_l")


@dataclass(frozen=True)
class Posture:
    """A body's linear model at the posture; n joints that no coupling determines.

    Attributes:
        coupling: (nv, n) velocities of all degrees of freedom per velocity of these joints.
        torque: (muscles, n) joint torque per activation, N m.
        excitation: (n, muscles) least-norm excitations per joint torque, 1/(N m): the joint-torque synergies.
        inertia: (n,) seen by each joint, kg m^2.
        holding: (muscles,) excitations in [0, 1] that hold the posture against gravity as well as any.
    """

    coupling: FloatArray
    torque: FloatArray
    excitation: FloatArray
    inertia: FloatArray
    holding: FloatArray


@lru_cache(maxsize=2)
@one_thread()
def posture_of(name: str) -> Posture:
    """The linear model of a body (0.1 s)."""
    body = load_body(name)
    data = mujoco.MjData(body.mj)
    coupling = _coupling(body)
    active, passive = _muscle_torques(body, data)
    torque = np.asarray(active @ coupling, float)
    squares = np.maximum((torque**2).sum(axis=0), _LEAST_SQUARE)
    excitation = np.linalg.solve(torque.T @ torque + _RIDGE * np.diag(squares), torque.T)
    inertia = np.zeros((body.mj.nv, body.mj.nv))
    body.start(data)
    mujoco.mj_fullM(body.mj, data, inertia)
    seen = np.maximum(np.diag(coupling.T @ inertia @ coupling), _LEAST_INERTIA).astype(float)
    needed = coupling.T @ (_standing_load(body, data) - passive)
    return Posture(coupling, torque, excitation, seen, _holding(torque, needed))


def _coupling(body: Body) -> FloatArray:
    """(nv, n) with the polynomials of the joint couplings linearised at the posture."""
    m = body.mj
    column = {int(j): k for k, j in enumerate(body.joint_ids)}
    matrix = np.zeros((m.nv, len(body.joints)))
    matrix[body.speeds, np.arange(len(body.joints))] = 1.0
    for i in range(m.neq):
        follower, leader = int(m.eq_obj1id[i]), int(m.eq_obj2id[i])
        if m.eq_type[i] != mujoco.mjtEq.mjEQ_JOINT or leader not in column:
            continue
        place = m.jnt_qposadr[leader]
        x = body.posture[place] - m.qpos0[place]
        slope = sum(k * m.eq_data[i, k] * x ** (k - 1) for k in range(1, 5))
        matrix[m.jnt_dofadr[follower], column[leader]] += slope
    return matrix


def _muscle_torques(body: Body, data: mujoco.MjData) -> tuple[FloatArray, FloatArray]:
    """(muscles, nv) generalised force per activation, and (nv,) of all passive muscles."""
    m = body.mj
    forces = []
    for activation in (0.0, 1.0):
        mujoco.mj_resetDataKeyframe(m, data, 0)
        data.act[:] = activation
        mujoco.mj_forward(m, data)
        forces.append(data.actuator_force.copy())
    arms = np.zeros((m.nu, m.nv))
    mujoco.mju_sparse2dense(
        arms, data.actuator_moment.ravel(), data.moment_rownnz, data.moment_rowadr, data.moment_colind
    )
    return arms * (forces[1] - forces[0])[:, None], forces[0] @ arms


def _standing_load(body: Body, data: mujoco.MjData) -> FloatArray:
    """(nv,) generalised force that holds the posture on two feet.

    Both feet carry half of the weight. Between them, the point of pressure lies below the centre of mass.
    """
    m = body.mj
    load = data.qfrc_bias - data.qfrc_passive
    heels = [m.body(name).id for name in _HEELS]
    centre = data.subtree_com[body.root]
    weight = np.array([0.0, 0.0, body.mass * GRAVITY / 2])
    for heel in heels:
        point = centre + data.xpos[heel] - data.xpos[heels].mean(axis=0)
        point[2] = 0.0
        jacobian = np.zeros((3, m.nv))
        mujoco.mj_jac(m, data, jacobian, None, point, heel)
        load = load - jacobian.T @ weight
    return load


def _holding(torque: FloatArray, needed: FloatArray) -> FloatArray:
    """(muscles,) bounded least squares: torques as needed, each relative to what its muscles can do."""
    scale = 1.0 / np.maximum(np.abs(torque).sum(axis=0), _LEAST_TORQUE)
    tone = _REST_WEIGHT * np.eye(len(torque))
    rows = np.concatenate([(torque * scale).T, tone])
    right = np.concatenate([needed * scale, np.full(len(torque), _REST_WEIGHT * _REST)])
    return np.asarray(lsq_linear(rows, right, (0.0, 1.0)).x)
