"""Plays many policies, here or in the processes of an executor; results do not depend on which."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from concurrent.futures import Executor
from multiprocessing.reduction import ForkingPickler
from typing import Any

from hdsafebo.errors import ProblemError
from hdsafebo.policies.affine import AffinePolicy
from hdsafebo.policies.environments import EnvironmentMaker
from hdsafebo.policies.episode import Episode, play_episode

_MOST_ENVIRONMENTS = 4
"""Kept per thread; the oldest is closed for a fifth."""

_local = threading.local()
Job = tuple[EnvironmentMaker, AffinePolicy, int, int]


def play_all(
    maker: EnvironmentMaker,
    policies: Sequence[AffinePolicy],
    seeds: Sequence[int],
    horizon: int,
    executor: Executor | None = None,
) -> list[list[Episode]]:
    """Play every policy once per seed.

    Args:
        maker: makes the environment, once per process and thread.
        policies: n of them.
        seeds: s of them.
        horizon: most steps of an episode.
        executor: spreads the episodes over its workers; None plays them here, one by one.

    Returns:
        n lists of s episodes, in the order of policies and seeds.

    Raises:
        ProblemError: the environment cannot be made, or cannot be sent to worker processes.
    """
    jobs = [(maker, policy, int(seed), horizon) for policy in policies for seed in seeds]
    if executor is None:
        episodes = [_play(job) for job in jobs]
    else:
        _check_travels(maker)
        episodes = list(executor.map(_play, jobs))
    return [episodes[i : i + len(seeds)] for i in range(0, len(episodes), len(seeds))]


def _play(job: Job) -> Episode:
    """One episode, in this thread's environment."""
    maker, policy, seed, horizon = job
    made = _environments()
    key = _key(maker)
    if key not in made:
        if len(made) >= _MOST_ENVIRONMENTS:
            made.pop(next(iter(made))).close()
        made[key] = maker.make()
    episode = play_episode(made[key], policy, seed, horizon)
    if episode.failure is not None:
        made.pop(key).close()  # what has failed once may fail again for no fault of the next policy
    return episode


def _environments() -> dict[Any, Any]:
    """This thread's environments."""
    made: dict[Any, Any] = _local.__dict__.setdefault("made", {})
    return made


def _key(maker: EnvironmentMaker) -> Any:
    """Equal for makers of equal environments."""
    return maker.source, repr(sorted(maker.arguments.items()))


def _check_travels(maker: EnvironmentMaker) -> None:
    """Refuse a maker that worker processes could not be told of, before any of them fails on it."""
    try:
        ForkingPickler.dumps(maker)
    except Exception as error:  # what cannot be sent says so in many ways
        raise ProblemError(
            f"environment {maker.name!r} cannot be made in worker processes: {error}; pass the id of a "
            "registered environment or a function defined at the top level of a module"
        ) from None
