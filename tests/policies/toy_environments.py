"""Small environments: a point that is pushed to the origin, and others with one fault each."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium as gym
import numpy as np


class Point(gym.Env):
    """A point in the plane; actions push it, the reward is minus its distance from the origin."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 50}

    def __init__(self, horizon: int = 20, fault: str = "", render_mode: str | None = None) -> None:
        self.horizon, self.fault, self.render_mode = horizon, fault, render_mode
        self.observation_space: gym.Space = gym.spaces.Box(-10.0, 10.0, (4,), np.float32)
        self.action_space: gym.Space = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
        if fault == "discrete":
            self.action_space = gym.spaces.Discrete(3)
        if fault == "dict":
            self.observation_space = gym.spaces.Dict({"a": self.observation_space})
        if fault == "unbounded":
            self.action_space = gym.spaces.Box(-np.inf, np.inf, (2,), np.float32)
        if fault == "whole":
            self.action_space = gym.spaces.Box(0, 3, (2,), np.int64)
        self.steps, self.played = 0, 0
        self.position, self.speed = np.zeros(2), np.zeros(2)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        self.played += 1
        self.steps, self.speed = 0, np.zeros(2)
        self.position = np.ones(2) if self.fault == "no_seed" else self.np_random.uniform(0.5, 1.5, 2)
        if self.fault == "forgetful":
            self.position = self.position + 0.01 * self.played
        return self.seen(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        self.steps += 1
        self.speed = 0.8 * self.speed + 0.1 * np.asarray(action, float)
        self.position = self.position + 0.1 * self.speed
        if self.fault == "raises":
            raise RuntimeError("the motor is hot")
        if self.fault == "raises_on_strong" and np.abs(action).max() > 0.95:
            raise RuntimeError("the motor is hot")
        distance = float(np.hypot(*self.position))
        info = {"cost": float(self.steps > 10), "distance": distance}
        if self.fault == "says_so":
            info["failure"] = "diverged: out of this world"
        fallen = self.fault == "falls" and self.steps == 7
        reward: Any = {"nan_reward": np.nan, "text_reward": "1_0"}.get(self.fault, -distance)
        return self.seen(), reward, fallen, self.steps >= self.horizon, info

    def seen(self) -> np.ndarray:
        values = np.concatenate([self.position, self.speed]).astype(np.float32)
        if self.fault == "nan":
            values[1] = np.nan
        return np.full(4, "1_0") if self.fault == "text" else values

    def render(self) -> np.ndarray:
        picture = np.zeros((48, 64, 3), np.uint8)
        column = int(np.clip(32 + 10 * self.position[0], 0, 63))
        picture[:, column] = 255
        return picture


def make_point(**arguments: Any) -> Point:
    """A point, made where worker processes can find it."""
    return Point(**arguments)
