"""The environment keeps the rules of Gymnasium and of stable-baselines3."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check
from stable_baselines3.common.env_checker import check_env as sb3_check

import hdsafebo.hand  # noqa: F401  registers the environment
from hdsafebo.errors import UnknownNameError
from hdsafebo.hand.environment import BottleHandEnv
from hdsafebo.hand.observation import SETTINGS

ID = "hdsafebo/BottleHand-v0"


def test_gymnasium_checker() -> None:
    environment = gymnasium.make(ID, variant="forearm")
    gymnasium_check(environment.unwrapped, skip_render_check=True)


@pytest.mark.parametrize("setting", list(SETTINGS))
def test_stable_baselines_checker(setting: str) -> None:
    sb3_check(BottleHandEnv("forearm", setting=setting))


def test_registered_once() -> None:
    assert gymnasium.spec(ID).entry_point == "hdsafebo.hand.environment:BottleHandEnv"


def test_terms_are_logged_one_by_one() -> None:
    environment = BottleHandEnv("forearm")
    environment.reset(seed=0)
    _, reward, terminated, truncated, info = environment.step(np.zeros(43, np.float32))
    weights = {
        "pose": 1,
        "bonus": 1,
        "penalty": -10,
        "grasp": 1,
        "survive": 2,
        "activation": -1,
        "drop": -100,
    }
    assert reward == pytest.approx(sum(w * info[f"reward/{name}"] for name, w in weights.items()))
    assert not terminated
    assert not truncated
    assert {"tilt", "bottle_speed", "peak_contact_speed", "dropped", "in_forearm", "failure"} <= set(info)


def test_the_horizon_truncates_and_a_drop_terminates() -> None:
    environment = BottleHandEnv("forearm", horizon=3)
    environment.reset()
    outcomes = [environment.step(-0.9 * np.ones(43, np.float32))[2:4] for _ in range(3)]
    assert outcomes[:2] == [(False, False)] * 2
    assert outcomes[2] == (False, True)
    environment = BottleHandEnv("forearm")
    environment.reset()
    environment.simulation.data.qpos[-7] += 1.0
    ends = []
    while not any(ends):
        ends = list(environment.step(np.zeros(43, np.float32))[2:4])
    assert ends == [True, False]


@pytest.mark.filterwarnings("ignore")
def test_divergence_ends_the_episode() -> None:
    environment = BottleHandEnv("forearm")
    observation, _ = environment.reset()
    environment.simulation.data.qvel[0] = 1e12
    after, reward, terminated, truncated, info = environment.step(np.zeros(43, np.float32))
    assert (reward, terminated, truncated) == (-100.0, True, False)
    assert "diverged" in info["failure"]
    np.testing.assert_array_equal(after, observation)


def test_unknown_setting() -> None:
    with pytest.raises(UnknownNameError, match="observation setting"):
        BottleHandEnv("forearm", setting="everything")
