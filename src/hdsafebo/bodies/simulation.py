"""One episode of standing after a push: physics and what is measured of it, without Gymnasium."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from hdsafebo.bodies.model import Body, load_body
from hdsafebo.bodies.posture import GRAVITY, posture_of
from hdsafebo.typing import FloatArray

CONTROL_INTERVAL = 0.01
"""s between two actions: 100 Hz."""
LEAST_HEIGHT = 0.9
"""Of the pelvis, in units of its height in the posture; below, a harness catches the body: it has fallen."""
MOST_TILT = 0.3
"""rad; beyond, too. Of 114 bodies that leaned by half of it, none came back (benchmarks/body_inputs.py)."""
_BAD_STATE = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


@dataclass(frozen=True)
class BodyMeasurement:
    """What is seen of the body after a control step.

    Attributes:
        angles: (n,) of the independent joints, from the posture, rad (m for sliding joints).
        speeds: (n,) their velocities, rad/s.
        height: of the pelvis above where it is in the posture, m.
        tilt: angle of the pelvis from upright, rad.
        lean: (2,) horizontal components of the pelvis' upward axis.
        turning: (3,) angular velocity of the pelvis, rad/s.
        offset: (2,) centre of mass over the middle of the feet, from where it is in the posture, m: to the
            body's left, and backwards.
        drift: (2,) its velocity, m/s.
    """

    angles: FloatArray
    speeds: FloatArray
    height: float
    tilt: float
    lean: FloatArray
    turning: FloatArray
    offset: FloatArray
    drift: FloatArray

    @property
    def vector(self) -> FloatArray:
        """(2 n + 10,) all of it but the tilt, which the lean determines."""
        parts = (self.angles, self.speeds, [self.height], self.lean, self.turning, self.offset, self.drift)
        return np.concatenate(parts)


class StandingSimulation:
    """A body on a flat floor, pushed once, and moved by its muscles.

    Attributes:
        body: the body.
        data: state of the simulation.
        steps: control steps done in this episode.
    """

    def __init__(self, name: str) -> None:
        self.body: Body = load_body(name)
        self.data = mujoco.MjData(self.body.mj)
        self._holding = posture_of(name).holding
        self._substeps = round(CONTROL_INTERVAL / self.body.mj.opt.timestep)
        self.steps = 0
        self.body.start(self.data)
        self._centre = self._over_feet()

    def reset(self, push: FloatArray, disturbance: FloatArray | None = None) -> BodyMeasurement:
        """Begin an episode: the posture, muscles as they hold it, and a push.

        Args:
            push: (2,) horizontal velocity that the whole body is given, m/s.
            disturbance: (n,) added to the angles of the independent joints, rad; None adds nothing.
        """
        body, data = self.body, self.data
        mujoco.mj_resetDataKeyframe(body.mj, data, 0)
        if disturbance is not None:
            data.qpos[body.angles] += disturbance
        data.qvel[:2] += push
        data.act[:] = self._holding
        mujoco.mj_forward(body.mj, data)
        self.steps = 0
        return self.measure()

    def step(self, excitation: FloatArray) -> BodyMeasurement:
        """Apply (muscles,) excitations in [0, 1] for one control interval."""
        self.data.ctrl[:] = excitation
        mujoco.mj_step(self.body.mj, self.data, self._substeps)
        self.steps += 1
        return self.measure()

    def measure(self) -> BodyMeasurement:
        """What is seen of the body now."""
        body, data = self.body, self.data
        mujoco.mj_subtreeVel(body.mj, data)
        up = data.xmat[body.pelvis].reshape(3, 3) @ body.upright
        return BodyMeasurement(
            angles=data.qpos[body.angles] - body.posture[body.angles],
            speeds=data.qvel[body.speeds].copy(),
            height=float(data.xpos[body.pelvis, 2] - body.height),
            tilt=float(np.arccos(np.clip(up[2], -1.0, 1.0))),
            lean=up[:2],
            turning=data.qvel[3:6].copy(),
            offset=self._over_feet() - self._centre,
            drift=data.subtree_linvel[body.root, :2].copy(),
        )

    def fallen(self, seen: BodyMeasurement) -> bool:
        """Whether the pelvis is too low or too far from upright."""
        return seen.height < (LEAST_HEIGHT - 1.0) * self.body.height or seen.tilt > MOST_TILT

    def joint_load(self) -> float:
        """Largest torque that stops and couplings of the independent joints exert now, N m."""
        return float(np.abs(self.data.qfrc_constraint[self.body.speeds]).max())

    def ground_reaction(self) -> float:
        """Normal force of all contacts now, in body weights."""
        force, total = np.zeros(6), 0.0
        for contact in range(self.data.ncon):
            mujoco.mj_contactForce(self.body.mj, self.data, contact, force)
            total += force[0]
        return float(total / (self.body.mass * GRAVITY))

    def failure(self) -> str | None:
        """Why the state is not physical, or None."""
        for warning in _BAD_STATE:
            if self.data.warning[warning].number:
                return f"diverged: MuJoCo reports {warning.name} after {self.steps} control steps"
        return None

    def _over_feet(self) -> FloatArray:
        """(2,) centre of mass from the middle of heels and toes, m."""
        body, data = self.body, self.data
        return np.asarray((data.subtree_com[body.root] - data.xpos[body.feet].mean(axis=0))[:2])
