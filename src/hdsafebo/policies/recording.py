"""What initial policies meet: the observations that normalisation and behaviour features come from.

The recorded episodes also show whether results can be trusted to be a policy's own: the same seed must give
the same episode again, and different seeds different ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdsafebo.errors import ProblemError
from hdsafebo.policies.episode import Episode
from hdsafebo.problem import floats
from hdsafebo.typing import FloatArray


def recorded_observations(episodes: Sequence[Sequence[Episode]], name: str) -> FloatArray:
    """(n, o) all observations of the recorded episodes that gave a result.

    Raises:
        ProblemError: none did.
    """
    good = [e.observations for played in episodes for e in played if e.failure is None]
    if not good:
        reasons = sorted({str(e.failure) for played in episodes for e in played})
        raise ProblemError(
            f"none of {len(episodes)} initial policies of {name!r} gives a result: {'; '.join(reasons[:3])}"
        )
    return np.concatenate(good)


def checked_observations(given: FloatArray, size: int, name: str) -> FloatArray:
    """(n, o) observations that were recorded before.

    Raises:
        ProblemError: they are none, not finite, or not this environment's.
    """
    observations = floats(given, "recorded observations")
    if observations.ndim != 2 or len(observations) == 0 or observations.shape[1] != size:
        raise ProblemError(f"observations of shape {observations.shape} for {name!r}; expected (n, {size})")
    if not np.isfinite(observations).all():
        raise ProblemError(f"recorded observations of {name!r} are not finite; record them again")
    return observations


def check_seeds(
    episodes: Sequence[Sequence[Episode]], again: Episode, seeds: Sequence[int], name: str
) -> None:
    """Refuse seeds that decide nothing, and episodes that they do not decide.

    Args:
        episodes: of each policy, one per seed.
        again: the first policy's episode with the first seed, played once more.
        seeds: of the episodes.
        name: of the environment.

    Raises:
        ProblemError: as above.
    """
    first = episodes[0][0]
    if first.failure is None and not _same(first, again):
        raise ProblemError(
            f"environment {name!r} gives another episode when it is played again with seed {seeds[0]}; "
            "expected all its randomness to come from reset(seed=...)"
        )
    for k in range(1, len(seeds)):
        if all(_same(played[0], played[k]) for played in episodes):
            raise ProblemError(
                f"seeds {seeds[0]} and {seeds[k]} of {name!r} give the same episodes; "
                "pass one seed, or an environment whose reset(seed=...) changes the start"
            )


def _same(a: Episode, b: Episode) -> bool:
    return np.array_equal(a.observations, b.observations) and np.array_equal(a.rewards, b.rewards)
