"""The reward is the paper's sum of terms."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.hand.reward import Reward

QUIET = {
    "tilt": 1.0,
    "in_forearm": False,
    "displacement": 0.0,
    "palm_distance": 0.0,
    "mean_square_activation": 0.0,
    "dropped": False,
}


def total(**changes: float | bool) -> float:
    return Reward.of(**(QUIET | changes)).total  # type: ignore[arg-type]


def test_formula_of_the_paper() -> None:
    reward = Reward(pose=1.0, bonus=10.0, penalty=100.0, grasp=1e3, survive=1e4, activation=1e5, drop=1e6)
    assert reward.total == 1.0 + 10.0 - 10 * 100.0 + 1e3 + 2 * 1e4 - 1e5 - 100 * 1e6
    assert set(reward.as_dict()) == {"pose", "bonus", "penalty", "grasp", "survive", "activation", "drop"}


@pytest.mark.parametrize(
    ("tilt", "expected"), [(1.0, 0.0), (0.35, 0.0), (0.34, 2.0), (0.15, 2.0), (0.14, 4.0)]
)
def test_bonus_grows_as_the_bottle_rises(tilt: float, expected: float) -> None:
    reward = Reward.of(**(QUIET | {"tilt": tilt}))  # type: ignore[arg-type]
    assert reward.bonus == expected
    assert reward.pose == pytest.approx(-3.5 * tilt)


def test_each_term() -> None:
    quiet = total()
    assert total(displacement=0.21) - quiet == pytest.approx(-10)
    assert total(displacement=0.2) == quiet
    assert total(palm_distance=0.1) - quiet == pytest.approx(-0.5)
    assert total(mean_square_activation=0.25) - quiet == pytest.approx(-0.25)
    assert total(dropped=True) - quiet == pytest.approx(-102)


def test_no_credit_in_the_place_of_the_forearm() -> None:
    upright = {"tilt": 0.0}
    assert total(**upright, in_forearm=True) == pytest.approx(2 - 3.5 * np.pi / 2)
    assert total(**upright) == pytest.approx(2 + 4)
    assert total(tilt=3.0, in_forearm=True) == total(tilt=3.0)
