"""The bottle task as a Gymnasium environment, `hdsafebo/BottleHand-v0`."""

from __future__ import annotations

from typing import Any, cast

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from hdsafebo.hand.scene.model import Variant, hand_model
from hdsafebo.hand.simulation import HORIZON, BottleSimulation

ENVIRONMENT_ID = "hdsafebo/BottleHand-v0"
FAILURE_REWARD = -100.0
OBSERVATION_LIMIT = 10.0
"""Entries of the observation are of the order of one; they are cut here."""

Observation = NDArray[np.float32]


class BottleHandEnv(gym.Env[Observation, NDArray[np.float32]]):
    """Turn a bottle from lying across the hand to upright, cap up, and hold it there.

    Actions in [-1, 1] are muscle excitations of (a + 1) / 2, one per muscle. The episode ends when the
    bottle drops below 0.4 m, and is cut at the horizon. `info` holds the terms of the reward
    (`reward/pose`, ...), `tilt`, `bottle_speed`, `peak_contact_speed`, `dropped`, `in_forearm`, and
    `failure`: None, or why the simulation diverged (the episode then ends with a reward of -100).

    Args:
        variant: which hand, `forearm` or `extended`.
        roll: rotation of the fixed upper arm, rad.
        horizon: control steps (20 ms each) per episode.
        setting: which parts of the observation are shown (see `observation.SETTINGS`).
        render_mode: `rgb_array` or None.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}

    def __init__(
        self,
        variant: Variant = "extended",
        roll: float = 1.4,
        horizon: int = HORIZON,
        setting: str = "full",
        render_mode: str | None = None,
    ) -> None:
        self.simulation = BottleSimulation(hand_model(variant, roll), horizon)
        self._columns = self.simulation.observer.columns(setting)
        self.render_mode = render_mode
        self._renderer: Any = None
        self.action_space = gym.spaces.Box(-1.0, 1.0, (self.simulation.model.nu,), np.float32)
        self.observation_space = gym.spaces.Box(
            -OBSERVATION_LIMIT, OBSERVATION_LIMIT, (len(self._columns),), np.float32
        )
        self._last: Observation = np.zeros(len(self._columns), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; the start pose is always the same."""
        super().reset(seed=seed)
        self._last = self._shown(self.simulation.reset())
        return self._last, {}

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Apply an action for 20 ms."""
        step = self.simulation.step((np.asarray(action, float) + 1.0) / 2.0)
        info = {f"reward/{name}": value for name, value in step.reward.as_dict().items()} | {
            "tilt": step.tilt,
            "bottle_speed": self.simulation.bottle_speed,
            "peak_contact_speed": self.simulation.peak_contact_speed,
            "dropped": step.dropped,
            "in_forearm": step.in_forearm,
            "failure": step.failure,
        }
        if step.failure is not None:
            return self._last, FAILURE_REWARD, True, False, info
        self._last = self._shown(step.observation)
        return self._last, step.reward.total, step.dropped, step.ended and not step.dropped, info

    def _shown(self, observation: NDArray[np.float64]) -> Observation:
        """The part of an observation that the setting shows."""
        return np.clip(observation[self._columns], -OBSERVATION_LIMIT, OBSERVATION_LIMIT).astype(np.float32)

    def render(self) -> Any:
        """(height, width, 3) picture, uint8, in the mode `rgb_array`.

        Raises:
            RenderingUnavailableError: this machine has no OpenGL renderer.
        """
        if self.render_mode is None:
            return None
        from hdsafebo.hand.render import SceneRenderer

        if self._renderer is None:
            self._renderer = SceneRenderer(self.simulation.model)
        return cast(SceneRenderer, self._renderer).picture(self.simulation.data)

    def close(self) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
