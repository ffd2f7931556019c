"""Best policies of the body, played again: how long they stay up, and after pushes that no trial met."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdsafebo.bodies.simulation import CONTROL_INTERVAL
from hdsafebo.params import BodyProblem, Space
from hdsafebo.pictures.offscreen import Picture
from hdsafebo.policies import GymnasiumPolicies
from hdsafebo.policies.episode import Episode
from hdsafebo.problems.body import sustained, torque_synergies
from hdsafebo.problems.reflexes import ReflexGainsProblem
from hdsafebo.typing import FloatArray

FRAMES_PER_SECOND = 12.5
_SHOWN = 5
"""Pictures of a strip."""
_STRIDE = 2
"""Every second pixel row and column: a strip is shown small."""


@dataclass(frozen=True)
class Outcome:
    """What a policy did after some pushes.

    Attributes:
        seconds: time until the fall, or the whole episode, per push.
        loads: largest torque of joint stops and couplings over 0.1 s, per push, N m.
        total: mean return.
        failure: why a simulation failed, or None.
    """

    seconds: list[float]
    loads: list[float]
    total: float
    failure: str | None


def weights_of(settings: BodyProblem, policies: GymnasiumPolicies, z: FloatArray, space: Space) -> FloatArray:
    """(D,) weights of a searched point of the body task.

    Args:
        settings: of the task.
        policies: its problem.
        z: (d,) what was searched.
        space: of which z is a point.
    """
    if space == "gains":
        return ReflexGainsProblem(policies, settings.body).weights(z)
    if space == "torques":
        codes = torque_synergies(policies, settings.body).decode(z[None])
        return np.clip(codes, *policies.bounds)[0]
    return z


def outcome_of(policies: GymnasiumPolicies, weights: FloatArray, pushes: Sequence[int]) -> Outcome:
    """Play a policy once after each push."""
    episodes = policies.play(weights, seeds=pushes)
    return Outcome(
        seconds=[episode.steps * CONTROL_INTERVAL for episode in episodes],
        loads=[_load(episode) for episode in episodes],
        total=float(np.mean([episode.total_reward for episode in episodes])),
        failure=next((episode.failure for episode in episodes if episode.failure), None),
    )


def _load(episode: Episode) -> float:
    return sustained(float(info["joint_load"]) for info in episode.infos)


def strip(frames: Sequence[Picture]) -> Picture:
    """(h, w, 3) five pictures of an episode side by side, the first of the start and the last of the end."""
    chosen = np.linspace(0, len(frames) - 1, _SHOWN).round().astype(int)
    return np.concatenate([_middle(frames[k])[::_STRIDE, ::_STRIDE] for k in chosen], axis=1)


def beside(left: Sequence[Picture], right: Sequence[Picture]) -> list[Picture]:
    """Pictures of two episodes side by side; the one that ended first stays as it ended."""
    length = max(len(left), len(right))
    pairs = [(left[min(k, len(left) - 1)], right[min(k, len(right) - 1)]) for k in range(length)]
    return [np.concatenate([_middle(a), _middle(b)], axis=1) for a, b in pairs]


def _middle(picture: Picture) -> Picture:
    """The middle half of the columns: a standing body is narrow."""
    width = picture.shape[1]
    return picture[:, width // 4 : width // 4 + width // 2]
