"""Training, actors and activations: the NumPy actor is the network, and equal settings give equal bytes."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import HandModelError
from hdsafebo.hand.rollout import Scene
from hdsafebo.hand.training.activations import (
    Agent,
    activation_table,
    agents_of,
    best_agent,
    explorations,
    explore,
    learning_curve,
)
from hdsafebo.hand.training.actor import Actor, load_actors, save_actors
from hdsafebo.hand.training.train import SacSettings, Trained, Training, actor_of, train_agent

SCENE = Scene("forearm", horizon=40)
SMALL = SacSettings(steps=400, width=16, learning_starts=100, batch_size=32)


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Training:
    return Training(SCENE, "posture", SMALL, 3, tmp_path_factory.mktemp("sac"))


@pytest.fixture(scope="module")
def trained(job: Training) -> Trained:
    return train_agent(job)


def test_checkpoints_and_learning_curve(job: Training, trained: Trained) -> None:
    assert sorted(trained.actors) == [40, 100, 200, 300, 400]
    weights = [actor.mean[0] for actor in trained.actors.values()]
    assert (weights[0] == weights[1]).all()  # no update before learning starts
    assert (weights[1] != weights[-1]).any()
    curve = learning_curve([trained])
    assert list(curve.columns) == ["setting", "step", "total_reward", "dropped"]
    assert len(curve) >= 400 // 40
    assert curve["step"].is_monotonic_increasing
    assert np.isfinite(curve["total_reward"]).all()
    assert job.progress.stat().st_size == 4


def test_equal_trainings_give_equal_files(job: Training, trained: Trained, tmp_path: Path) -> None:
    again = Training(job.scene, job.setting, job.sac, job.seed, tmp_path)
    other = train_agent(again)
    assert again.archive.read_bytes() == job.archive.read_bytes()
    np.testing.assert_array_equal(other.total_reward, trained.total_reward)
    for step, actor in trained.actors.items():
        for name, tensor in actor.tensors().items():
            np.testing.assert_array_equal(tensor, other.actors[step].tensors()[name])


def test_archive_holds_no_address_and_can_be_loaded(job: Training, trained: Trained) -> None:
    from stable_baselines3 import SAC

    with zipfile.ZipFile(job.archive) as archive:
        assert b" at 0x" not in archive.read("data")
    agent = SAC.load(job.archive, device="cpu")
    actor = actor_of(agent)
    last = trained.actors[400].mean[0]
    assert np.abs(actor.mean[0] - last).max() < 0.01 * np.abs(last).max() + 0.01  # one update later
    observation = np.linspace(-1, 1, actor.hidden[0][0].shape[1]).astype(np.float32)
    expected = agent.predict(observation, deterministic=True)[0]
    np.testing.assert_allclose(actor.action(observation), expected, atol=2e-6)


def test_numpy_actor_is_the_network_of_the_agent() -> None:
    from stable_baselines3 import SAC

    from hdsafebo.hand.environment import BottleHandEnv

    agent = SAC(
        "MlpPolicy",
        BottleHandEnv("forearm"),
        use_sde=True,
        policy_kwargs={"net_arch": [8, 8]},
        seed=0,
        device="cpu",
        buffer_size=10,
    )
    actor = actor_of(agent)
    rng = np.random.default_rng(0)
    for scale in (0.1, 1.0, 10.0):  # the last one reaches the limit of the mean
        observation = (scale * rng.standard_normal(55)).astype(np.float32)
        expected = agent.predict(observation, deterministic=True)[0]
        np.testing.assert_allclose(actor.action(observation), expected, atol=2e-6)


def test_exploration_spreads_by_the_learned_deviation() -> None:
    rng = np.random.default_rng(0)
    hidden = ((np.eye(3, dtype=np.float32), np.zeros(3, np.float32)),)
    actor = Actor(
        hidden, (np.zeros((2, 3), np.float32), np.zeros(2, np.float32)), np.full((3, 2), -1.0, np.float32)
    )
    observation = np.array([0.3, 0.4, 0.0], np.float32)
    raw = [np.arctanh(actor.action(observation, actor.exploration(rng))) for _ in range(4000)]
    np.testing.assert_allclose(np.std(raw, axis=0), np.exp(-1.0) * 0.5, rtol=0.05)


def test_actors_come_back_from_their_file(trained: Trained, tmp_path: Path) -> None:
    path = tmp_path / "actors.safetensors"
    agents = agents_of([trained])
    save_actors(path, {agent.name: agent.actor for agent in agents}, digest="x")
    loaded = load_actors(path)
    assert sorted(loaded) == sorted(agent.name for agent in agents)
    for agent in agents:
        for name, tensor in agent.actor.tensors().items():
            np.testing.assert_array_equal(loaded[agent.name].tensors()[name], tensor)


def test_bad_actor_files_are_refused(trained: Trained, tmp_path: Path) -> None:
    path = tmp_path / "bad.safetensors"
    with pytest.raises(HandModelError, match="cannot be read as actors"):
        load_actors(path)
    path.write_bytes(b"\x80\x04pickled")
    with pytest.raises(HandModelError, match="cannot be read as actors"):
        load_actors(path)
    tensors = trained.actors[400].tensors()
    with pytest.raises(HandModelError, match=r"without 'mean\.bias'"):
        Actor.from_tensors({name: value for name, value in tensors.items() if name != "mean.bias"})
    with pytest.raises(HandModelError, match="do not fit"):
        Actor.from_tensors(tensors | {"mean.weight": tensors["mean.weight"][:, :-1]})
    with pytest.raises(HandModelError, match="not finite"):
        Actor.from_tensors(tensors | {"mean.bias": np.full_like(tensors["mean.bias"], np.nan)})


def test_activations_have_one_row_per_step(trained: Trained) -> None:
    agents = agents_of([trained])
    jobs = explorations(SCENE, agents, 7, seed=5)
    assert [job.agent.name for job in jobs[:6]] == [a.name for a in agents] + [agents[0].name]
    blocks = [explore(job) for job in jobs]
    muscles = SCENE.simulation().hand.muscles
    table = activation_table(blocks, muscles)
    assert list(table.columns) == ["episode", "step", *muscles]
    assert {str(kind) for kind in table.dtypes[:2]} == {"int32"}
    assert {str(kind) for kind in table.dtypes[2:]} == {"float32"}
    assert table.groupby("episode").size().tolist() == [len(block) for block in blocks]
    assert table[list(muscles)].to_numpy().min() >= 0
    assert table[list(muscles)].to_numpy().max() <= 1
    np.testing.assert_array_equal(explore(jobs[4]), blocks[4])
    assert (blocks[0][:5] != blocks[5][:5]).any()  # the same agent explores differently


def test_best_agent_returns_most(trained: Trained) -> None:
    agents = agents_of([trained])
    best, excitations = best_agent(SCENE, agents)
    simulation = SCENE.simulation()

    def total(agent: Agent) -> float:
        return replay(best_agent(SCENE, [agent])[1])

    def replay(sequence: np.ndarray) -> float:
        simulation.reset()
        return sum(simulation.step(excitation).reward.total for excitation in sequence)

    totals = {agent.name: total(agent) for agent in agents}
    assert totals[best.name] == max(totals.values()) == replay(excitations)
