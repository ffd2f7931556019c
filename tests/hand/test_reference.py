"""Reference observations and the kernel metric that they give."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import HandModelError
from hdsafebo.hand.policy import LinearPolicySpace
from hdsafebo.hand.reference import Difficulty, behaviour_map, load_moment, observation_moment, save_moment
from hdsafebo.hand.rollout import Episodes, Scene, episode
from hdsafebo.hand.scene.model import hand_model

SCENE = Scene("forearm", horizon=10)


def test_moment_is_the_mean_over_all_steps() -> None:
    simulation = SCENE.simulation()
    space = LinearPolicySpace.original(simulation.pose.activation, simulation.observer.size)
    policies = np.random.default_rng(0).uniform(-0.05, 0.05, (3, space.dimension))
    seen = [o for w in space.weights(policies) for o, _, _ in episode(simulation, space, w)]
    expected = np.mean([np.outer(o, o) for o in seen], axis=0)
    np.testing.assert_allclose(observation_moment(SCENE, space, policies), expected, atol=1e-12)


def test_features_measure_what_policies_do() -> None:
    """Squared distance of features: mean square difference of the drives on the observations."""
    rng = np.random.default_rng(0)
    observations = rng.standard_normal((500, 9)) * np.linspace(0.1, 2, 9)
    moment = observations.T @ observations / 500
    one, other = rng.standard_normal((2, 4, 9))
    expected = np.mean([np.sum(((one - other) @ o) ** 2) for o in observations])
    assert np.sum(((one - other) @ behaviour_map(moment, 9)) ** 2) == pytest.approx(expected)
    few = np.sum(((one - other) @ behaviour_map(moment, 3)) ** 2)
    assert 0 < few < expected


def test_bad_moments_are_refused() -> None:
    with pytest.raises(HandModelError, match="second moment"):
        behaviour_map(np.ones((3, 4)), 2)
    with pytest.raises(HandModelError, match="4 directions"):
        behaviour_map(np.eye(3), 4)


def test_moment_belongs_to_its_hand(tmp_path: Path) -> None:
    path = tmp_path / "observations.safetensors"
    hand = hand_model("forearm")
    with pytest.raises(HandModelError, match="no second moment"):
        load_moment(path, hand)
    save_moment(path, np.eye(55), hand)
    np.testing.assert_array_equal(load_moment(path, hand), np.eye(55))
    with pytest.raises(HandModelError, match="belongs to model"):
        load_moment(path, hand_model("extended"))
    save_moment(path, np.full((2, 2), np.nan), hand)
    with pytest.raises(HandModelError, match="finite square matrix"):
        load_moment(path, hand)


def outcome(tilt: list[float], dropped: list[bool], speed: list[float]) -> Episodes:
    n = len(tilt)
    return Episodes(
        np.arange(n, dtype=float),
        np.array(speed),
        np.zeros(n),
        np.array(dropped),
        np.array(tilt),
        np.zeros(n),
        np.full(n, 120),
        (None,) * n,
    )


def test_difficulty_counts() -> None:
    episodes = outcome([0.1, 1.0, 2.0, 0.2], [False, True, True, True], [0.0, 4.45, 4.2, 4.39])
    zero = outcome([1.2], [False], [0.0])
    found = Difficulty.of(episodes, zero, 4.4)
    assert (found.policies, found.dropped, found.upright, found.safe) == (4, 0.75, 0.25, 0.75)
    assert found.return_quantiles[0] == 0
    assert found.return_quantiles[-1] == 3
    assert found.trivial
    lying = outcome([1.0] * 4, [False] * 4, [0.0] * 4)
    assert not Difficulty.of(lying, zero, 4.4).trivial
    assert Difficulty.of(lying, outcome([0.1], [False], [0.0]), 4.4).trivial
