"""Blocks of the musculoskeletal hand."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from hdsafebo.params.base import Block, Count, Positive


class HandScene(Block):
    """Model and episode.

    Attributes:
        variant: forearm (43 muscles, 23 joints) or extended (55 muscles, 28 joints, as in the paper).
        roll: rotation of the fixed upper arm, rad, which sets how far the forearm must pronate.
        horizon: control steps of 20 ms per episode.
    """

    variant: Literal["forearm", "extended"] = "extended"
    roll: Annotated[float, Field(ge=0, le=1.57)] = 1.4
    horizon: Count = 120


class HandSac(Block):
    """Training of the agents whose activations carry the synergies.

    Attributes:
        settings: observation settings; one agent each.
        steps: control steps per agent.
        width: units of each of the two hidden layers.
        train_every: control steps between updates.
        updates: gradient steps per update.
        seed: of all agents.
    """

    settings: Annotated[list[Literal["full", "posture", "bottle", "touch"]], Field(min_length=1)] = [
        "full",
        "bottle",
    ]
    steps: Annotated[int, Field(ge=600)] = 20_000
    width: Count = 128
    train_every: Count = 4
    updates: Count = 2
    seed: Annotated[int, Field(ge=0)] = 0


class HandRollouts(Block):
    """Episodes of all checkpoints of all agents, with exploration.

    Attributes:
        episodes: number of episodes.
        seed: of the exploration.
    """

    episodes: Annotated[int, Field(ge=2)] = 200
    seed: Annotated[int, Field(ge=0)] = 0


class HandSynergies(Block):
    """Components of the activations, and what random policies over them do.

    Attributes:
        count: synergies of the latent space.
        box: limit of the size of each weight of a policy over synergies.
        landing_limit: landing speed up to which a policy counts as safe, m/s (paper, appendix).
        random_policies: policies drawn from the box that show how hard the task is.
        reference_policies: of these, the policies whose observations give the kernel its metric.
        seed: of the random policies.
    """

    count: Annotated[int, Field(ge=1, le=10)] = 5
    box: Positive = 1.0
    landing_limit: Positive = 4.4
    random_policies: Annotated[int, Field(ge=2)] = 200
    reference_policies: Annotated[int, Field(ge=2)] = 50
    seed: Annotated[int, Field(ge=0)] = 0


class Hand(Block):
    """Musculoskeletal hand: model, environment, rollouts and synergies."""

    scene: HandScene = HandScene()
    sac: HandSac = HandSac()
    rollouts: HandRollouts = HandRollouts()
    synergies: HandSynergies = HandSynergies()
