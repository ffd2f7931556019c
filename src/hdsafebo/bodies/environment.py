"""Staying up after a push as a Gymnasium environment: `hdsafebo/PushedBody-v0`, `hdsafebo/PushedLegs-v0`."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from hdsafebo.bodies.simulation import CONTROL_INTERVAL, BodyMeasurement, StandingSimulation
from hdsafebo.errors import ProblemError

HORIZON = 500
"""Control steps of 10 ms: 5 s."""
OBSERVATION_LIMIT = 1000.0
"""SI units; observations are cut here, far beyond what a standing body shows."""
# Alone, each of these leaves 1/e of what standing still gives:
_SWAY_WEIGHT = 40.0  # per m^2: a sway of 16 cm
_TILT_WEIGHT = 2.0  # per rad^2: a trunk at 40 degrees
_EFFORT_WEIGHT = 3.0  # per mean squared excitation: all muscles at 0.58
_SPEED_WEIGHT = 0.002  # per (rad/s)^2 of the joints, on average: 22 rad/s

Observation = NDArray[np.float32]
Action = NDArray[np.float32]


class PushedBodyEnv(gym.Env[Observation, Action]):
    """Stay up after a push, with one action per muscle.

    The episode begins in a standing posture, with muscles active as they hold it, and a horizontal velocity
    of the whole body that the seed draws. A fall ends it, caught by a harness: the pelvis below 0.9 of its
    height, or tilted by more than 0.3 rad. Actions in [-1, 1] are muscle excitations of (a + 1) / 2, kept for
    10 ms. Observations are in SI units (see `BodyMeasurement.vector`).

    Reward of a step: exp(-40 offset^2 - 2 tilt^2 - 3 mean(excitation^2) - 0.002 mean(speed^2)), in m and rad.
    It is never negative, so that who stands longer never has less.

    `info` holds `joint_load` (largest torque of joint stops and couplings, N m), `ground_reaction` (body
    weights), `tilt` (rad), `offset` (m), `effort` (mean squared excitation), `time` (s) and `failure`: None,
    or why the simulation diverged, which terminates the episode.

    Args:
        body: `myofullbody` (416 muscles, 152 observations) or `myolegs` (80).
        push: standard deviation of each component of the push, m/s.
        disturbance: standard deviation of the first joint angles about the posture, rad.
        horizon: control steps of an episode.
        render_mode: `rgb_array` or None.
    """

    metadata: dict[str, Any] = {
        "render_modes": ["rgb_array"],
        "render_fps": round(1.0 / CONTROL_INTERVAL),
    }

    def __init__(
        self,
        body: str = "myofullbody",
        push: float = 0.1,
        disturbance: float = 0.0,
        horizon: int = HORIZON,
        render_mode: str | None = None,
    ) -> None:
        for name, value in (("push", push), ("disturbance", disturbance)):
            if not (np.isfinite(value) and value >= 0):
                raise ProblemError(f"{name} is {value}; expected a finite number, at least 0")
        if horizon < 1:
            raise ProblemError(f"horizon is {horizon}; expected at least 1 control step")
        if render_mode not in (None, "rgb_array"):
            raise ProblemError(f"render_mode is {render_mode!r}; expected 'rgb_array' or None")
        self.simulation = StandingSimulation(body)
        self.push, self.disturbance, self.horizon = push, disturbance, horizon
        self.render_mode = render_mode
        self._renderer: Any = None
        size = self.simulation.measure().vector.size
        self.observation_space = gym.spaces.Box(-OBSERVATION_LIMIT, OBSERVATION_LIMIT, (size,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (self.simulation.body.mj.nu,), np.float32)
        self._last: Observation = np.zeros(size, np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode with a push of its own."""
        super().reset(seed=seed)
        angles = self.disturbance * self.np_random.standard_normal(len(self.simulation.body.joints))
        push = self.push * self.np_random.standard_normal(2)
        self._last = _shown(self.simulation.reset(push, angles))
        return self._last, {"push": push}

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Apply an action for 10 ms."""
        excitation = np.clip((np.asarray(action, float) + 1.0) / 2.0, 0.0, 1.0)
        seen = self.simulation.step(excitation)
        effort = float(np.mean(excitation**2))
        failure = self.simulation.failure()
        info = {
            "joint_load": self.simulation.joint_load(),
            "ground_reaction": self.simulation.ground_reaction(),
            "tilt": seen.tilt,
            "offset": float(np.hypot(*seen.offset)),
            "effort": effort,
            "time": self.simulation.steps * CONTROL_INTERVAL,
            "failure": failure,
        }
        if failure is not None:
            return self._last, 0.0, True, False, info
        self._last = _shown(seen)
        fallen = self.simulation.fallen(seen)
        last = self.simulation.steps >= self.horizon
        return self._last, _reward(seen, effort), fallen, last, info

    def render(self) -> Any:
        """(height, width, 3) picture, uint8, in the mode `rgb_array`.

        Raises:
            RenderingUnavailableError: this machine has no OpenGL renderer.
        """
        if self.render_mode is None:
            return None
        from hdsafebo.bodies.render import BodyRenderer

        if self._renderer is None:
            self._renderer = BodyRenderer(self.simulation.body)
        return self._renderer.picture(self.simulation.data)

    def close(self) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def _shown(seen: BodyMeasurement) -> Observation:
    """The observation of what is seen."""
    return np.clip(seen.vector, -OBSERVATION_LIMIT, OBSERVATION_LIMIT).astype(np.float32)


def _reward(seen: BodyMeasurement, effort: float) -> float:
    """Of one control step: 1 for standing still at no cost, less for what sways, tilts, moves and costs."""
    sway = float(seen.offset @ seen.offset)
    speed = float(np.mean(seen.speeds**2))
    cost = _SWAY_WEIGHT * sway + _TILT_WEIGHT * seen.tilt**2 + _EFFORT_WEIGHT * effort + _SPEED_WEIGHT * speed
    return float(np.exp(-cost))
