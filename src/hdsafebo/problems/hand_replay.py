"""Policies of run files, back in the hand: what a searched point does when it is played again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import HandModelError
from hdsafebo.hand.policy import LinearPolicySpace
from hdsafebo.hand.rollout import Scene, evaluate_policies, policy_excitations
from hdsafebo.hand.synergies import load_synergies, synergy_policies
from hdsafebo.params.hand import Hand
from hdsafebo.problems.hand import SYNERGY_FILE


@dataclass(frozen=True)
class Replay:
    """What a policy did when it was played again.

    Attributes:
        excitations: (steps, muscles) of the episode.
        total_reward: return of the episode; None where the simulation failed.
        tilt: mean tilt of the last 20 steps, rad; None where the simulation failed.
        upright: the bottle ended upright, held by the hand.
        dropped: it fell.
        failure: why the simulation failed, or None.
    """

    excitations: NDArray[np.float64]
    total_reward: float | None
    tilt: float | None
    upright: bool
    dropped: bool
    failure: str | None


def scene_of(hand: Hand) -> Scene:
    """The scene that the parameters describe."""
    return Scene(hand.scene.variant, hand.scene.roll, hand.scene.horizon)


def replay(hand: Hand, z: NDArray[np.float64], *, latent: bool, root: Path) -> Replay:
    """Play a searched point of the hand task.

    Args:
        hand: the parameters of the hand.
        z: (d,) weights over synergies, or over muscles.
        latent: z are weights over synergies.
        root: the project's directory.

    Raises:
        HandModelError: the synergies are missing or another hand's, or z has the wrong size.
    """
    scene = scene_of(hand)
    simulation = scene.simulation()
    space = synergy_policies(
        scene, load_synergies(root / SYNERGY_FILE, simulation.hand), hand.synergies.count
    )
    if latent:
        if z.shape != (space.dimension,):
            raise HandModelError(
                f"policy of shape {z.shape}; expected ({space.dimension},): "
                f"{hand.synergies.count} x {space.observations} weights over synergies"
            )
        z = space.to_original(z[None])[0]  # as the task evaluates it
    original = LinearPolicySpace.original(space.base, space.observations)
    outcome = evaluate_policies(scene, original, z[None])
    failure = outcome.failures[0]
    return Replay(
        excitations=policy_excitations(scene, original, z),
        total_reward=None if failure else float(outcome.total_reward[0]),
        tilt=None if failure else float(outcome.tilt[0]),
        upright=bool(outcome.upright[0]),
        dropped=bool(outcome.dropped[0]),
        failure=failure,
    )
