"""Makes environments, here and in worker processes, and checks that policies can act in them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np

from hdsafebo.errors import ProblemError
from hdsafebo.typing import FloatArray

Factory = Callable[..., Any]


@dataclass(frozen=True)
class EnvironmentMaker:
    """How an environment is made; small, so that it travels to worker processes.

    Attributes:
        source: id of a registered environment, or a function that makes one.
        arguments: keyword arguments of either.
    """

    source: str | Factory
    arguments: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """For messages and files."""
        if isinstance(self.source, str):
            return self.source
        return str(getattr(self.source, "__qualname__", type(self.source).__name__))

    def make(self, **more: Any) -> Any:
        """A new environment.

        Raises:
            ProblemError: there is no environment of that id, or making it failed.
        """
        make = gym.make if isinstance(self.source, str) else self.source
        first = (self.source,) if isinstance(self.source, str) else ()
        try:
            environment = make(*first, **(dict(self.arguments) | more))
        except Exception as error:  # each environment fails in its own way
            given = ", ".join(f"{k}={v!r}" for k, v in (dict(self.arguments) | more).items())
            raise ProblemError(
                f"environment {self.name!r} cannot be made with ({given}): {type(error).__name__}: {error}"
            ) from error
        for method in ("reset", "step", "action_space", "observation_space"):
            if not hasattr(environment, method):
                raise ProblemError(
                    f"environment {self.name!r} has no {method}; expected a gymnasium.Env, "
                    f"got {type(environment).__name__}"
                )
        return environment


def check_spaces(environment: Any, name: str) -> None:
    """Refuse spaces that no affine policy acts in.

    Raises:
        ProblemError: a space is no `Box` of real numbers, or actions are not bounded.
    """
    for what in ("observation", "action"):
        space = getattr(environment, f"{what}_space")
        if not isinstance(space, gym.spaces.Box):
            raise ProblemError(
                f"{what} space of {name!r} is {type(space).__name__}; expected a Box of real numbers "
                "(gymnasium.wrappers.FlattenObservation flattens dicts; discrete actions need another policy)"
            )
    space = environment.action_space
    if not np.issubdtype(space.dtype, np.floating):
        raise ProblemError(f"actions of {name!r} have type {space.dtype}; expected floats")
    if not (np.isfinite(space.low).all() and np.isfinite(space.high).all()):
        raise ProblemError(
            f"actions of {name!r} are not bounded; expected finite limits "
            "(gymnasium.wrappers.RescaleAction or ClipAction sets some)"
        )


def action_limits(environment: Any) -> tuple[FloatArray, FloatArray]:
    """(k,) least and largest actions."""
    space = environment.action_space
    return np.ravel(np.asarray(space.low, float)), np.ravel(np.asarray(space.high, float))


def horizon_of(environment: Any, name: str, given: int | None) -> int:
    """Most steps of an episode: as given, or the environment's own.

    Raises:
        ProblemError: neither is there, or the given one is below 1.
    """
    if given is not None:
        if given < 1:
            raise ProblemError(f"horizon is {given}; expected at least 1 step")
        return int(given)
    spec = getattr(environment, "spec", None)
    known = getattr(spec, "max_episode_steps", None) or getattr(environment.unwrapped, "horizon", None)
    if known is None:
        raise ProblemError(f"environment {name!r} has no limit of steps; pass horizon=...")
    return int(known)
