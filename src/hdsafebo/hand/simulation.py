"""One episode of the bottle task: the single code path that environment, rollouts and pictures share."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from hdsafebo.errors import HandModelError
from hdsafebo.hand.observation import CONTROL_INTERVAL, Observer, tilt
from hdsafebo.hand.reward import Reward
from hdsafebo.hand.scene.bottle import BOTTLE, BOTTLE_SHAPE
from hdsafebo.hand.scene.model import FOREARM_SHAPES, HandModel
from hdsafebo.hand.scene.start_pose import placed_model, reset, start_pose
from hdsafebo.typing import FloatArray

DROP_HEIGHT = 0.4
"""m; a bottle below it has dropped (paper, appendix)."""

HORIZON = 120  # control steps
MAX_FALL_S = 1.0  # a free fall from the start to the drop height takes 0.45 s
MAX_OVERLAP = 0.01  # m of the bottle within the forearm, which does not touch it
MAX_BOTTLE_SPEED = 30.0  # m/s
MAX_JOINT_SPEED = 1000.0  # rad/s; beyond both, numbers and not muscles move the scene
_BAD_STATE = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


@dataclass(frozen=True)
class Step:
    """What happened in one control step.

    Attributes:
        observation: (observations,) after the step.
        reward: the terms of the reward.
        tilt: of the bottle, rad.
        in_forearm: the bottle is in the place of the forearm, deeper than flesh gives way.
        dropped: the bottle fell below 0.4 m in this step.
        ended: the episode is over: dropped, horizon reached, or the simulation failed.
        failure: why the simulation cannot be trusted, or None.
    """

    observation: FloatArray
    reward: Reward
    tilt: float
    in_forearm: bool
    dropped: bool
    ended: bool
    failure: str | None


class BottleSimulation:
    """Simulates episodes of holding and righting the bottle.

    Attributes:
        hand: the hand.
        model: its MuJoCo model at the height of the start pose.
        data: the state of the simulation.
        observer: computes observations.
        steps: control steps done in this episode.
        bottle_speed: speed of the bottle now, m/s; after a drop, the speed at which it crossed 0.4 m.
        peak_contact_speed: largest speed of the bottle so far while something touched it, m/s.
    """

    def __init__(self, hand: HandModel, horizon: int = HORIZON) -> None:
        if horizon < 1:
            raise HandModelError(f"horizon is {horizon}; expected at least 1 control step")
        self.hand = hand
        self.pose = start_pose(hand)
        self.model = placed_model(hand, self.pose)
        self.data = mujoco.MjData(self.model)
        self.horizon = horizon
        self._bottle = self.model.body(BOTTLE).id
        self._start = self.pose.qpos[-7:-4].copy()
        self.observer = Observer(hand, self.model, self._start)
        self._shape = self.model.geom(BOTTLE_SHAPE).id
        self._forearm = [self.model.geom(name).id for name in FOREARM_SHAPES]
        self._substeps = round(CONTROL_INTERVAL / self.model.opt.timestep)
        self.reset()

    def reset(self) -> FloatArray:
        """Begin an episode in the start pose; returns the first observation."""
        reset(self.model, self.data, self.pose)
        self.steps = 0
        self.bottle_speed = 0.0
        self.peak_contact_speed = 0.0
        return self.observer.observe(self.data)

    def step(self, excitation: FloatArray) -> Step:
        """Apply muscle excitations for one control interval.

        A drop ends the step at the physics step in which it happens. When the horizon is reached while
        the bottle is in free fall, the fall is finished within this step, with the excitations kept.

        Args:
            excitation: (muscles,) clipped to [0, 1].

        Raises:
            HandModelError: wrong shape, or not finite.
        """
        values = np.asarray(excitation, float)
        if values.shape != (self.model.nu,):
            raise HandModelError(
                f"excitations have shape {values.shape}; "
                f"the hand {self.hand.variant!r} expects ({self.model.nu},)"
            )
        if not np.isfinite(values).all():
            raise HandModelError(
                f"excitation of {self.hand.muscles[int(np.argmin(np.isfinite(values)))]} is not finite"
            )
        data = self.data
        np.clip(values, 0.0, 1.0, out=data.ctrl)
        dropped = self._advance(self._substeps, in_free_fall=False)
        self.steps += 1
        last = self.steps >= self.horizon
        if last and not dropped:
            dropped = self._advance(round(MAX_FALL_S / self.model.opt.timestep), in_free_fall=True)
        failure = self._failure()
        position = data.xpos[self._bottle]
        angle = tilt(data.xmat[self._bottle].reshape(3, 3)[:, 2])
        in_forearm = self._overlap_with_forearm() > MAX_OVERLAP
        reward = Reward.of(
            tilt=angle,
            in_forearm=in_forearm,
            displacement=float(np.linalg.norm(position - self._start)),
            palm_distance=float(np.linalg.norm(position - self.observer.palm(data))),
            mean_square_activation=float(np.mean(np.square(data.act))),
            dropped=dropped,
        )
        ended = dropped or last or failure is not None
        return Step(self.observer.observe(data), reward, angle, in_forearm, dropped, ended, failure)

    def _advance(self, substeps: int, *, in_free_fall: bool) -> bool:
        """Step the physics, watching the bottle after every step; True when it dropped.

        Args:
            substeps: most physics steps to take.
            in_free_fall: stop as soon as something touches the bottle.
        """
        model, data = self.model, self.data
        for _ in range(substeps):
            if in_free_fall and data.ncon:
                return False
            height, speed = data.qpos[-5], self.bottle_speed
            mujoco.mj_step(model, data)
            x, y, z = data.qvel[-6:-3]
            self.bottle_speed = float(np.sqrt(x * x + y * y + z * z))
            if data.qpos[-5] < DROP_HEIGHT:
                share = (height - DROP_HEIGHT) / (height - data.qpos[-5])
                self.bottle_speed = float(speed + share * (self.bottle_speed - speed))
                return True
            if data.ncon and self.bottle_speed > self.peak_contact_speed:
                self.peak_contact_speed = self.bottle_speed
        return False

    def _overlap_with_forearm(self) -> float:
        """How deep the bottle is within the shapes of the forearm, m; at most 0 without overlap."""
        distances = [
            mujoco.mj_geomDistance(self.model, self.data, geom, self._shape, MAX_OVERLAP, None)
            for geom in self._forearm
        ]
        return -min(distances)

    def _failure(self) -> str | None:
        """Why the state is not physical, or None."""
        data = self.data
        after = f"after {self.steps} control steps"
        for warning in _BAD_STATE:
            if data.warning[warning].number:
                return f"diverged: MuJoCo reports {warning.name} {after}"
        if self.bottle_speed > MAX_BOTTLE_SPEED:
            return f"diverged: bottle at {self.bottle_speed:.0f} m/s {after}"
        speeds = np.abs(data.qvel[:-6])
        if speeds.max() > MAX_JOINT_SPEED:
            joint = self.hand.joints[int(speeds.argmax())]
            return f"diverged: joint {joint} at {speeds.max():.0f} rad/s {after}"
        return None
