"""One episode of a policy in an environment, and what is kept of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdsafebo.errors import RenderingUnavailableError
from hdsafebo.policies.affine import AffinePolicy
from hdsafebo.problem import floats
from hdsafebo.typing import FloatArray

FAILURE = "failure"
"""Key of `info` under which an environment says why its simulation cannot be trusted."""


@dataclass(frozen=True)
class Episode:
    """What a policy did in one episode of t steps: what safety functions are computed from.

    Attributes:
        observations: (t, o) what the policy saw before each action.
        actions: (t, k) what it did.
        rewards: (t,).
        infos: the environment's `info` of each step.
        terminated: the environment ended the episode before the horizon (a fall, a crash, a goal).
        horizon: most steps of an episode.
        failure: why the episode gave no result, or None: the environment raised, gave a NaN, or said so.
    """

    observations: FloatArray
    actions: FloatArray
    rewards: FloatArray
    infos: Sequence[dict[str, Any]]
    terminated: bool
    horizon: int
    failure: str | None = None

    @property
    def steps(self) -> int:
        """t."""
        return len(self.rewards)

    @property
    def total_reward(self) -> float:
        """Return of the episode."""
        return float(self.rewards.sum())


def play_episode(
    environment: Any,
    policy: AffinePolicy,
    seed: int,
    horizon: int,
    watch: Callable[[Any], None] | None = None,
) -> Episode:
    """Play a policy once.

    Args:
        environment: a Gymnasium environment.
        policy: what acts.
        seed: the environment is reset with it.
        horizon: most steps.
        watch: called with the environment after the reset and after each step.
    """
    observations: list[FloatArray] = []
    actions: list[FloatArray] = []
    rewards: list[float] = []
    infos: list[dict[str, Any]] = []
    terminated, failure = False, None
    try:
        observation, _ = environment.reset(seed=int(seed))
        failure = _not_finite(observation, 0.0, len(rewards))
        while failure is None and not terminated and len(rewards) < horizon:
            if watch is not None:
                watch(environment)
            action = policy(observation)
            observations.append(np.ravel(floats(observation, "observation")))
            actions.append(np.ravel(np.asarray(action, float)))
            observation, reward, terminated, truncated, info = environment.step(action)
            rewards.append(float(floats(reward, "reward")))
            infos.append(dict(info))
            failure = info.get(FAILURE) or _not_finite(observation, rewards[-1], len(rewards))
            if truncated:
                break
        if watch is not None and failure is None:
            watch(environment)
    except RenderingUnavailableError:
        raise
    except Exception as error:  # whatever an environment raises is a failed trial, not the end of the search
        failure = f"{type(error).__name__} after {len(rewards)} steps: {error}"
    space = policy.space
    return Episode(
        observations=np.array(observations).reshape(-1, space.observations),
        actions=np.array(actions).reshape(-1, space.actions),
        rewards=np.array(rewards, float),
        infos=infos,
        terminated=bool(terminated),
        horizon=horizon,
        failure=None if failure is None else str(failure),
    )


def _not_finite(observation: Any, reward: float, step: int) -> str | None:
    """What is NaN or infinite, or None."""
    values = np.ravel(floats(observation, "observation"))
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        return f"observation {bad[0]} is {values[bad[0]]} after {step} steps"
    if not np.isfinite(reward):
        return f"reward is {reward} after {step} steps"
    return None
