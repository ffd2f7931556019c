"""Observations: their length, their parts, and the geometry of the tilt."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdsafebo.errors import UnknownNameError
from hdsafebo.hand.observation import SETTINGS, righting_rotation, tilt
from hdsafebo.hand.rollout import Scene


@pytest.mark.parametrize(("variant", "size"), [("forearm", 55), ("extended", 65)])
def test_extended_hand_has_the_length_of_the_paper(variant: str, size: int) -> None:
    simulation = Scene(variant).simulation()
    observation = simulation.reset()
    assert simulation.observer.size == size == len(observation)
    ends = sorted((part.start, part.stop) for part in simulation.observer.parts.values())
    assert ends[0][0] == 0
    assert ends[-1][1] == size
    assert all(one[1] == other[0] for one, other in pairwise(ends))


def test_start_is_seen_as_at_rest_in_the_start_pose() -> None:
    simulation = Scene("extended").simulation()
    observation, parts = simulation.reset(), simulation.observer.parts
    for name in ("joint_velocity", "displacement", "velocity", "spin"):
        assert not observation[parts[name]].any(), name
    np.testing.assert_array_equal(observation[parts["angle"]], simulation.pose.qpos[:28])
    np.testing.assert_array_equal(observation[parts["constant"]], [1.0])
    assert np.linalg.norm(observation[parts["axis"]]) == pytest.approx(1.0)
    assert np.linalg.norm(observation[parts["righting"]]) == pytest.approx(tilt(observation[parts["axis"]]))


def test_settings_show_their_parts() -> None:
    observer = Scene("extended").simulation().observer
    assert len(observer.columns("full")) == observer.size
    for name, parts in SETTINGS.items():
        length = sum(observer.parts[part].stop - observer.parts[part].start for part in parts)
        assert len(np.unique(observer.columns(name))) == length
    with pytest.raises(UnknownNameError, match=r"'blind'.*bottle, full, posture, touch"):
        observer.columns("blind")


@given(st.floats(0.001, np.pi - 0.001), st.floats(-np.pi, np.pi))
def test_righting_rotation_rights_the_axis(angle: float, direction: float) -> None:
    """Rodrigues' rotation by the vector brings the axis upright, through the angle of the tilt."""
    axis = np.array([np.sin(angle) * np.cos(direction), np.sin(angle) * np.sin(direction), np.cos(angle)])
    assert tilt(axis) == pytest.approx(angle)
    vector = np.append(righting_rotation(axis), 0.0)
    size = np.linalg.norm(vector)
    assert size == pytest.approx(angle)
    unit = vector / size
    turned = (
        axis * np.cos(size) + np.cross(unit, axis) * np.sin(size) + unit * (unit @ axis) * (1 - np.cos(size))
    )
    np.testing.assert_allclose(turned, [0, 0, 1], atol=1e-9)


def test_tilt_at_the_poles() -> None:
    assert tilt(np.array([0.0, 0.0, 1.0])) == 0.0
    assert tilt(np.array([0.0, 0.0, -1.0])) == pytest.approx(np.pi)
    for sign in (1.0, -1.0):
        np.testing.assert_array_equal(righting_rotation(np.array([0.0, 0.0, sign])), [0.0, 0.0])
