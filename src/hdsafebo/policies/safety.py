"""Safety functions of episodes. Of several evaluation seeds, the least value counts."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from hdsafebo.errors import ProblemError
from hdsafebo.policies.episode import Episode
from hdsafebo.problem import Safety


@dataclass(frozen=True)
class EpisodeSafety:
    """A safety function of policies, computed from an episode.

    Attributes:
        safety: its name and threshold.
        value: of an episode; safe when it is at least the threshold.
    """

    safety: Safety
    value: Callable[[Episode], float]

    def of(self, episode: Episode) -> float:
        """The value of an episode.

        Raises:
            ProblemError: the function gave no finite number.
        """
        value = self.value(episode)
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = np.nan
        if not np.isfinite(number):
            raise ProblemError(
                f"safety function {self.safety.name!r} gave {value!r} for an episode of {episode.steps} "
                "steps; expected a finite number"
            )
        return number


def survives(name: str = "survival") -> EpisodeSafety:
    """The episode must not be terminated.

    The value is 1 for an episode that lasts, else minus the share of the horizon that was left: graded, so
    that a model can tell a late fall from an early one.
    """

    def value(episode: Episode) -> float:
        left = episode.horizon - episode.steps + 1
        return -left / episode.horizon if episode.terminated else 1.0

    return EpisodeSafety(Safety(name, 0.0), value)


def lasts(steps: int, name: str = "lasts") -> EpisodeSafety:
    """The episode must last at least so many steps; the value is their share of the horizon.

    Raises:
        ProblemError: `steps` is below 1.
    """
    if steps < 1:
        raise ProblemError(f"lasts: steps is {steps}; expected at least 1")

    def value(episode: Episode) -> float:
        if steps > episode.horizon:
            raise ProblemError(f"lasts: steps is {steps}; expected at most the horizon, {episode.horizon}")
        done = episode.steps if episode.terminated else episode.horizon
        return (done - steps) / episode.horizon

    return EpisodeSafety(Safety(name, 0.0), value)


def budget(
    key: str,
    limit: float,
    reduce: Callable[[Iterable[float]], float] = sum,
    name: str | None = None,
) -> EpisodeSafety:
    """What the environment reports as `info[key]` must stay within a limit, such as `budget("cost", 25)`.

    The value is the limit minus the sum over the steps, or minus another reduction, such as `max`. Steps
    whose `info` has no such key count 0.

    Args:
        key: of `info`.
        limit: largest sum.
        reduce: of the values of all steps.
        name: of the safety function; None takes the key.
    """

    def value(episode: Episode) -> float:
        if episode.infos and not any(key in info for info in episode.infos):
            known = ", ".join(sorted({name for info in episode.infos for name in info})) or "none"
            raise ProblemError(f"budget: no step reports info[{key!r}]; the environment's keys are: {known}")
        return limit - float(reduce([float(info.get(key, 0.0)) for info in episode.infos]))

    return EpisodeSafety(Safety(key if name is None else name, 0.0), value)
