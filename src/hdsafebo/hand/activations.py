"""The data that synergies are fitted to: activations of trained agents of all skills, and their learning curves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hdsafebo.hand.actor import Actor
from hdsafebo.hand.environment import OBSERVATION_LIMIT
from hdsafebo.hand.rollout import Scene
from hdsafebo.hand.train import Trained

NOISE_STEPS = 25
"""Control steps (0.5 s) between new exploration matrices: longer than a muscle's activation takes to rise."""


@dataclass(frozen=True)
class Agent:
    """An actor and the observation setting it was trained under."""

    name: str
    setting: str
    actor: Actor


def agents_of(trained: list[Trained]) -> list[Agent]:
    """All checkpoints of all agents, by setting and training step."""
    return [Agent(f"{t.setting}/{step}", t.setting, t.actors[step]) for t in trained for step in sorted(t.actors)]


def collect_activations(
    scene: Scene, agents: list[Agent], episodes: int, seed: int, executor: Executor, advance: Callable[[], object] = lambda: None
) -> pd.DataFrame:
    """Activations in episodes of the agents, taken in turn, with time-correlated exploration.

    Args:
        scene: hand and horizon.
        agents: who acts.
        episodes: number of episodes.
        seed: episode e explores with the generator (seed, e).
        executor: spreads the episodes over its workers; the result does not depend on their number.
        advance: called after each episode.

    Returns:
        One row per control step: `episode`, `step` (int32) and one float32 column per muscle.
    """
    jobs = [(scene, agents[episode % len(agents)], seed, episode) for episode in range(episodes)]
    blocks = []
    for block in executor.map(_episode, jobs):
        blocks.append(block)
        advance()
    lengths = [len(block) for block in blocks]
    table = pd.DataFrame(np.concatenate(blocks), columns=list(scene.simulation().hand.muscles))
    table.insert(0, "episode", np.repeat(np.arange(episodes, dtype=np.int32), lengths))
    table.insert(1, "step", np.concatenate([np.arange(length, dtype=np.int32) for length in lengths]))
    return table


def learning_curve(trained: list[Trained]) -> pd.DataFrame:
    """One row per training episode: `setting`, `step`, `total_reward`, `dropped`."""
    return pd.concat(
        [pd.DataFrame({"setting": t.setting, "step": t.step, "total_reward": t.total_reward, "dropped": t.dropped}) for t in trained],
        ignore_index=True,
    )


def mean_episode(scene: Scene, agent: Agent) -> tuple[float, NDArray[np.float64]]:
    """Total reward, and (steps, muscles) excitations, of an episode of an agent's mean actions."""
    total, _, excitations = _run(scene, agent, None)
    return total, excitations


def best_agent(scene: Scene, agents: list[Agent]) -> Agent:
    """The agent whose mean actions return most."""
    returns: Mapping[str, float] = {agent.name: mean_episode(scene, agent)[0] for agent in agents}
    return max(agents, key=lambda agent: returns[agent.name])


def _episode(job: tuple[Scene, Agent, int, int]) -> NDArray[np.float32]:
    """(steps, muscles) activations of one exploring episode."""
    scene, agent, seed, episode = job
    return _run(scene, agent, np.random.default_rng((seed, episode)))[1]


def _run(scene: Scene, agent: Agent, rng: np.random.Generator | None) -> tuple[float, NDArray[np.float32], NDArray[np.float64]]:
    """Total reward, activations and excitations of one episode; without a generator the actions are the means."""
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
            break
        total += step.reward.total
        activations.append(simulation.data.act.astype(np.float32))
        observation = step.observation
        if step.ended:
            break
    return total, np.array(activations, np.float32).reshape(-1, len(simulation.hand.muscles)), np.array(excitations)
