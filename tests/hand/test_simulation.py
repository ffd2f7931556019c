"""Episodes: drops, falls that outlast the horizon, failures, and bad input."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from hdsafebo.errors import HandModelError
from hdsafebo.hand.scene.model import hand_model
from hdsafebo.hand.scene.start_pose import BOTTLE_HEIGHT
from hdsafebo.hand.simulation import DROP_HEIGHT, BottleSimulation, Step

FREE_FALL = np.sqrt(2 * 9.81 * (BOTTLE_HEIGHT - DROP_HEIGHT))


@pytest.fixture
def simulation() -> BottleSimulation:
    return BottleSimulation(hand_model("forearm"))


def away_from_hand(simulation: BottleSimulation, height: float = BOTTLE_HEIGHT) -> None:
    """Put the bottle where nothing is below it."""
    simulation.reset()
    simulation.data.qpos[-7:-4] = (1.0, 1.0, height)
    mujoco.mj_forward(simulation.model, simulation.data)


def run(simulation: BottleSimulation) -> Step:
    while True:
        step = simulation.step(simulation.pose.activation)
        if step.ended:
            return step


def test_a_free_fall_lands_at_its_closed_form_speed(simulation: BottleSimulation) -> None:
    away_from_hand(simulation)
    step = run(simulation)
    assert step.dropped
    assert simulation.bottle_speed == pytest.approx(FREE_FALL, abs=0.01)
    assert simulation.steps == int(np.ceil(FREE_FALL / 9.81 / 0.02))
    assert simulation.peak_contact_speed == 0.0
    assert step.reward.drop == 1
    assert step.reward.survive == 0


@pytest.mark.parametrize("offset", [0.0, 0.003, 0.007, 0.011, 0.017])
def test_landing_speed_does_not_depend_on_the_phase_of_the_physics_steps(
    simulation: BottleSimulation, offset: float
) -> None:
    """It is interpolated to the crossing: no rounding to the 0.02 m/s of a physics step."""
    away_from_hand(simulation, BOTTLE_HEIGHT + offset)
    run(simulation)
    exact = np.sqrt(2 * 9.81 * (BOTTLE_HEIGHT + offset - DROP_HEIGHT))
    assert simulation.bottle_speed == pytest.approx(exact, abs=0.011)


def test_a_fall_cut_by_the_horizon_is_finished() -> None:
    short = BottleSimulation(hand_model("forearm"), horizon=5)
    away_from_hand(short)
    step = run(short)
    assert short.steps == 5
    assert step.dropped
    assert step.reward.drop == 1
    assert short.bottle_speed == pytest.approx(FREE_FALL, abs=0.01)


def test_a_held_bottle_ends_slow_and_undropped(simulation: BottleSimulation) -> None:
    simulation.horizon = 10
    step = run(simulation)
    assert step.ended
    assert not step.dropped
    assert simulation.bottle_speed < 0.5
    assert 0 < simulation.peak_contact_speed < 1


def test_forearm_gives_no_hold_and_no_credit(simulation: BottleSimulation) -> None:
    """A bottle put onto the forearm falls through its place, which is seen."""
    simulation.reset()
    data, model = simulation.data, simulation.model
    data.qpos[-7:-4] = data.body("radius_r").xpos + np.array([0.12, 0.0, 0.02])
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    step = simulation.step(simulation.pose.activation)
    assert step.in_forearm
    assert step.reward.pose <= -3.5 * np.pi / 2 + 1e-9
    assert run(simulation).dropped
    assert simulation.bottle_speed > 4.0


@pytest.mark.filterwarnings("ignore")
def test_divergence_ends_the_episode_with_its_reason(simulation: BottleSimulation) -> None:
    simulation.reset()
    simulation.data.qvel[0] = 1e12
    step = simulation.step(simulation.pose.activation)
    assert step.ended
    assert "diverged" in str(step.failure)


def test_unphysical_speeds_are_failures(simulation: BottleSimulation) -> None:
    away_from_hand(simulation, 50.0)
    simulation.data.qvel[-4] = 100.0
    step = simulation.step(simulation.pose.activation)
    assert step.failure is not None
    assert step.failure.startswith("diverged: bottle at 100 m/s after 1 control steps")


def test_reset_forgets_the_last_episode(simulation: BottleSimulation) -> None:
    first = simulation.reset()
    rng = np.random.default_rng(0)
    for _ in range(5):
        simulation.step(rng.random(43))
    np.testing.assert_array_equal(simulation.reset(), first)
    assert (simulation.steps, simulation.bottle_speed, simulation.peak_contact_speed) == (0, 0.0, 0.0)


def test_bad_excitations_are_refused(simulation: BottleSimulation) -> None:
    with pytest.raises(HandModelError, match=r"shape \(3,\).*'forearm' expects \(43,\)"):
        simulation.step(np.zeros(3))
    broken = np.zeros(43)
    broken[7] = np.nan
    with pytest.raises(HandModelError, match="excitation of FCR is not finite"):
        simulation.step(broken)
    with pytest.raises(HandModelError, match="horizon is 0"):
        BottleSimulation(hand_model("forearm"), horizon=0)
