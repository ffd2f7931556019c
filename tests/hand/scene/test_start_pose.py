"""The start pose holds the bottle, and a pose that does not is refused."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from hdsafebo.errors import HandModelError
from hdsafebo.hand.observation import tilt
from hdsafebo.hand.scene import start_pose as module
from hdsafebo.hand.scene.bottle import BOTTLE
from hdsafebo.hand.scene.model import hand_model
from hdsafebo.hand.scene.start_pose import (
    BOTTLE_HEIGHT,
    MAX_PENETRATION,
    check_start_pose,
    placed_model,
    reset,
    start_pose,
)


@pytest.mark.parametrize("variant", ["forearm", "extended"])
@pytest.mark.parametrize("roll", [0.9, 1.4])
def test_bottle_lies_in_the_hand(variant: str, roll: float) -> None:
    hand = hand_model(variant, roll)  # type: ignore[arg-type]
    pose = start_pose(hand)
    assert pose.contacts >= 3
    assert pose.penetration < MAX_PENETRATION
    model = placed_model(hand, pose)
    data = mujoco.MjData(model)
    reset(model, data, pose)
    assert data.body(BOTTLE).xpos[2] == pytest.approx(BOTTLE_HEIGHT, abs=1e-12)
    assert tilt(data.body(BOTTLE).xmat.reshape(3, 3)[:, 2]) == pytest.approx(np.pi / 2, abs=0.35)
    assert not data.qvel.any()
    assert hand.mj.body("myoarm_r_root").pos[2] == 1.4  # the shared model is not moved


def test_found_once_and_repeatable() -> None:
    hand = hand_model("forearm")
    assert start_pose(hand) is start_pose(hand)
    again = module._search(hand)
    np.testing.assert_array_equal(again.qpos, start_pose(hand).qpos)
    np.testing.assert_array_equal(again.activation, start_pose(hand).activation)


def test_bad_poses_are_recognised() -> None:
    hand = hand_model("forearm")
    pose = start_pose(hand)
    away = pose.qpos.copy()
    away[-7] += 0.5
    assert "contact points" in str(check_start_pose(hand, replace(pose, qpos=away)))
    inside = pose.qpos.copy()
    inside[-5] -= 0.01
    assert "overlap" in str(check_start_pose(hand, replace(pose, qpos=inside)))
    broken = pose.qpos.copy()
    broken[0] = np.nan
    assert check_start_pose(hand, replace(pose, qpos=broken)) is not None


def test_no_candidate_is_a_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "candidates", lambda: iter([((0.3, 0.3, 0.3), 0.06)]))
    with pytest.raises(
        HandModelError, match=r"no start pose holds the bottle in the hand 'forearm'.*0 contact points"
    ):
        module._search(hand_model("forearm"))
