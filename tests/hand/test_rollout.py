"""Batched evaluation: the same bits for any batch, order, executor and process."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest

from hdsafebo.errors import HandModelError
from hdsafebo.hand import rollout
from hdsafebo.hand.policy import LinearPolicySpace
from hdsafebo.hand.rollout import Episodes, Scene, episode, evaluate_policies, policy_excitations
from hdsafebo.hand.simulation import BottleSimulation, Step

SCENE = Scene("forearm", horizon=60)


@pytest.fixture(scope="module")
def space() -> LinearPolicySpace:
    simulation = SCENE.simulation()
    return LinearPolicySpace.original(simulation.pose.activation, simulation.observer.size)


@pytest.fixture(scope="module")
def policies(space: LinearPolicySpace) -> np.ndarray:
    return np.random.default_rng(2).uniform(-0.1, 0.1, (6, space.dimension))


@pytest.fixture(scope="module")
def episodes(space: LinearPolicySpace, policies: np.ndarray) -> Episodes:
    return evaluate_policies(SCENE, space, policies)


def assert_same(one: Episodes, other: Episodes) -> None:
    for name, values in vars(one).items():
        np.testing.assert_array_equal(values, getattr(other, name), err_msg=name)


def test_order_and_batch_do_not_matter(
    space: LinearPolicySpace, policies: np.ndarray, episodes: Episodes
) -> None:
    backwards = evaluate_policies(SCENE, space, policies[::-1])
    np.testing.assert_array_equal(backwards.total_reward[::-1], episodes.total_reward)
    alone = evaluate_policies(SCENE, space, policies[3:4])
    assert alone.total_reward[0] == episodes.total_reward[3]
    assert len(np.unique(episodes.total_reward)) == len(policies)


def test_threads_give_the_same_bits(
    space: LinearPolicySpace, policies: np.ndarray, episodes: Episodes
) -> None:
    with ThreadPoolExecutor(2) as executor:
        assert_same(evaluate_policies(SCENE, space, policies, executor), episodes)


def test_new_processes_give_the_same_bits(
    space: LinearPolicySpace, policies: np.ndarray, episodes: Episodes
) -> None:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as executor:
        assert_same(evaluate_policies(SCENE, space, policies, executor), episodes)


def test_table_matches_the_steps_of_an_episode(
    space: LinearPolicySpace, policies: np.ndarray, episodes: Episodes
) -> None:
    simulation = BottleSimulation(SCENE.simulation().hand, SCENE.horizon)
    steps: list[Step] = [s for _, _, s in episode(simulation, space, space.weights(policies[:1])[0])]
    assert episodes.total_reward[0] == sum(step.reward.total for step in steps)
    assert episodes.tilt[0] == np.mean([step.tilt for step in steps[-20:]])
    assert episodes.steps[0] == len(steps)
    assert episodes.landing_speed[0] == simulation.bottle_speed
    assert episodes.handling_speed[0] == simulation.peak_contact_speed


def test_excitations_replay_the_episode(
    space: LinearPolicySpace, policies: np.ndarray, episodes: Episodes
) -> None:
    excitations = policy_excitations(SCENE, space, policies[1])
    simulation = SCENE.simulation()
    simulation.reset()
    assert sum(simulation.step(e).reward.total for e in excitations) == episodes.total_reward[1]


def test_no_policies_give_an_empty_table(space: LinearPolicySpace) -> None:
    empty = evaluate_policies(SCENE, space, np.empty((0, space.dimension)))
    assert len(empty.total_reward) == len(empty.upright) == len(empty.failed) == 0


def test_a_diverging_simulation_is_a_failure_not_a_number(
    space: LinearPolicySpace, policies: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hdsafebo.hand import simulation

    monkeypatch.setattr(simulation, "MAX_JOINT_SPEED", 0.5)
    outcome = evaluate_policies(SCENE, space, policies[:2])
    assert outcome.failed.all()
    assert np.isnan(outcome.total_reward).all()
    assert str(outcome.failures[0]).startswith("diverged: joint ")
    assert not outcome.upright.any()


def test_wrong_shape_is_refused_before_anything_runs(
    space: LinearPolicySpace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rollout, "_outcome", None)
    with pytest.raises(HandModelError, match="expected"):
        evaluate_policies(SCENE, space, np.zeros((2, 7)))
