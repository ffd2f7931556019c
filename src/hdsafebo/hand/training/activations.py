"""Activations of trained agents of all skills, which synergies are fitted to, and learning curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hdsafebo.hand.environment import OBSERVATION_LIMIT
from hdsafebo.hand.rollout import Scene
from hdsafebo.hand.training.actor import Actor
from hdsafebo.hand.training.train import Trained

NOISE_STEPS = 25
"""Control steps (0.5 s) between new exploration matrices: longer than a muscle's activation takes to rise."""


@dataclass(frozen=True)
class Agent:
    """An actor and the observation setting it was trained under."""

    name: str
    setting: str
    actor: Actor


def agents_of(trained: Sequence[Trained]) -> list[Agent]:
    """All checkpoints of all agents, by setting and training step."""
    return [
        Agent(f"{t.setting}/{step}", t.setting, t.actors[step]) for t in trained for step in sorted(t.actors)
    ]


@dataclass(frozen=True)
class Exploration:
    """One episode to run: plain data, so that it can run in any process.

    Attributes:
        scene: hand and horizon.
        agent: who acts.
        seed: of all episodes.
        episode: number of this one; its exploration comes from the generator (seed, episode).
    """

    scene: Scene
    agent: Agent
    seed: int
    episode: int


def explorations(scene: Scene, agents: Sequence[Agent], episodes: int, seed: int) -> list[Exploration]:
    """Episodes of the agents, taken in turn."""
    return [Exploration(scene, agents[e % len(agents)], seed, e) for e in range(episodes)]


def explore(job: Exploration) -> NDArray[np.float32]:
    """(steps, muscles) activations of an episode with time-correlated exploration."""
    rng = np.random.default_rng((job.seed, job.episode))
    return _run(job.scene, job.agent, rng)[1]


def activation_table(blocks: Sequence[NDArray[np.float32]], muscles: Sequence[str]) -> pd.DataFrame:
    """One row per control step: `episode`, `step` (int32) and one float32 column per muscle.

    Args:
        blocks: (steps, muscles) activations per episode.
        muscles: names of the columns.
    """
    lengths = [len(block) for block in blocks]
    table = pd.DataFrame(np.concatenate(list(blocks)), columns=list(muscles))
    table.insert(0, "episode", np.repeat(np.arange(len(blocks), dtype=np.int32), lengths))
    table.insert(1, "step", np.concatenate([np.arange(length, dtype=np.int32) for length in lengths]))
    return table


def learning_curve(trained: Sequence[Trained]) -> pd.DataFrame:
    """One row per training episode: `setting`, `step`, `total_reward`, `dropped`."""
    return pd.concat(
        [
            pd.DataFrame(
                {"setting": t.setting, "step": t.step, "total_reward": t.total_reward, "dropped": t.dropped}
            )
            for t in trained
        ],
        ignore_index=True,
    )


def best_agent(scene: Scene, agents: Sequence[Agent]) -> tuple[Agent, NDArray[np.float64]]:
    """The agent whose mean actions return most, and the (steps, muscles) excitations of that episode."""
    episodes = [_run(scene, agent, None) for agent in agents]
    best = int(np.argmax([total for total, _, _ in episodes]))
    return agents[best], episodes[best][2]


def _run(
    scene: Scene, agent: Agent, rng: np.random.Generator | None
) -> tuple[float, NDArray[np.float32], NDArray[np.float64]]:
    """Total reward, activations and excitations of an episode; without a generator, of mean actions."""
    simulation = scene.simulation()
    columns = simulation.observer.columns(agent.setting)
    observation = simulation.reset()
    exploration = None
    total = 0.0
    activations, excitations = [], []
    while True:
        if rng is not None and simulation.steps % NOISE_STEPS == 0:
            exploration = agent.actor.exploration(rng)
        shown = np.clip(observation[columns], -OBSERVATION_LIMIT, OBSERVATION_LIMIT).astype(np.float32)
        excitation = (agent.actor.action(shown, exploration).astype(float) + 1.0) / 2.0
        step = simulation.step(excitation)
        excitations.append(excitation)
        if step.failure is not None:
            total = -np.inf
            break
        total += step.reward.total
        activations.append(simulation.data.act.astype(np.float32))
        observation = step.observation
        if step.ended:
            break
    return (
        total,
        np.array(activations, np.float32).reshape(-1, len(simulation.hand.muscles)),
        np.array(excitations),
    )
