"""Bodies that stay up after a push: model, posture, reflexes and the rules of Gymnasium."""

from __future__ import annotations

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check
from stable_baselines3.common.env_checker import check_env as sb3_check

from hdsafebo.bodies.environment import PushedBodyEnv
from hdsafebo.bodies.model import load_body
from hdsafebo.bodies.posture import posture_of
from hdsafebo.bodies.reflex import ReflexGains, gain_limits, gain_ranges, random_gains, reflex
from hdsafebo.bodies.simulation import StandingSimulation
from hdsafebo.errors import ProblemError, UnknownNameError

LEGS = "myolegs"


def play(environment: PushedBodyEnv, excitation: np.ndarray, gain: np.ndarray, seed: int) -> dict[str, float]:
    """Time until the fall or the horizon, and the largest joint load."""
    observation, _ = environment.reset(seed=seed)
    load = 0.0
    while True:
        drive = np.clip(excitation + gain @ observation.astype(float), 0.0, 1.0)
        observation, _, fallen, last, info = environment.step((2.0 * drive - 1.0).astype(np.float32))
        load = max(load, info["joint_load"])
        if fallen or last:
            return {"time": info["time"], "load": load, "fallen": float(fallen)}


def test_gymnasium_checker() -> None:
    gymnasium_check(gymnasium.make("hdsafebo/PushedLegs-v0").unwrapped, skip_render_check=True)


def test_stable_baselines_checker() -> None:
    sb3_check(PushedBodyEnv(LEGS))


def test_the_whole_body_keeps_the_same_rules() -> None:
    environment = gymnasium.make("hdsafebo/PushedBody-v0", horizon=3)
    assert environment.action_space.shape == (416,)
    assert environment.observation_space.shape == (152,)
    gymnasium_check(environment.unwrapped, skip_render_check=True)
    sb3_check(environment.unwrapped)


def test_the_seed_draws_the_push_and_nothing_else() -> None:
    environment = PushedBodyEnv(LEGS)
    rest = np.zeros(80, np.float32)

    def episode(seed: int) -> np.ndarray:
        environment.reset(seed=seed)
        return np.array([environment.step(rest)[0] for _ in range(5)])

    first = episode(1)
    assert not np.array_equal(first, episode(2))
    np.testing.assert_array_equal(first, episode(1))


def test_a_push_is_a_velocity_of_the_whole_body() -> None:
    simulation = StandingSimulation(LEGS)
    seen = simulation.reset(np.array([0.1, -0.2]))
    np.testing.assert_allclose(seen.drift, [0.1, -0.2], atol=1e-9)
    np.testing.assert_allclose(seen.offset, 0.0, atol=1e-12)
    assert seen.tilt == pytest.approx(0.0, abs=1e-6)
    assert seen.vector.shape == (2 * len(simulation.body.joints) + 10,)


def test_limp_muscles_fall_and_the_fall_terminates() -> None:
    environment = PushedBodyEnv(LEGS)
    outcome = play(environment, np.zeros(80), np.zeros((80, 38)), seed=1)
    assert outcome["fallen"]
    assert outcome["time"] < 3.0


def test_the_horizon_truncates() -> None:
    environment = PushedBodyEnv(LEGS, horizon=3)
    environment.reset(seed=0)
    ends = [environment.step(np.zeros(80, np.float32))[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]


@pytest.mark.filterwarnings("ignore")
def test_divergence_terminates_and_says_why() -> None:
    environment = PushedBodyEnv(LEGS)
    observation, _ = environment.reset(seed=0)
    environment.simulation.data.qvel[0] = 1e12
    after, reward, terminated, truncated, info = environment.step(np.zeros(80, np.float32))
    assert (reward, terminated, truncated) == (0.0, True, False)
    assert "diverged" in info["failure"]
    np.testing.assert_array_equal(after, observation)
    environment.reset(seed=0)
    assert environment.step(np.zeros(80, np.float32))[4]["failure"] is None


def test_couplings_move_with_the_independent_joints() -> None:
    """A small step of the independent joints along the coupling keeps every joint coupling satisfied."""
    body, coupling = load_body(LEGS), posture_of(LEGS).coupling
    m, data = body.mj, mujoco.MjData(body.mj)

    def residual(step: np.ndarray) -> np.ndarray:
        body.start(data)
        velocity = coupling @ step
        mujoco.mj_integratePos(m, data.qpos, velocity, 1.0)
        mujoco.mj_forward(m, data)
        rows = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        return data.efc_pos[: data.nefc][rows].copy()

    at_rest = residual(np.zeros(len(body.joints)))
    step = 1e-4 * np.random.default_rng(0).standard_normal(len(body.joints))
    moved = residual(step) - at_rest
    alone = coupling.copy()
    alone[np.setdiff1d(np.arange(m.nv), body.speeds)] = 0.0
    body.start(data)
    mujoco.mj_integratePos(m, data.qpos, alone @ step, 1.0)
    mujoco.mj_forward(m, data)
    rows = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    without = data.efc_pos[: data.nefc][rows] - at_rest
    assert np.abs(moved).max() < 1e-2 * np.abs(without).max()


def test_muscle_torques_are_what_muscles_do() -> None:
    """The torque per activation predicts the change of the actuators' generalised force."""
    body, posture = load_body(LEGS), posture_of(LEGS)
    data = mujoco.MjData(body.mj)
    forces = []
    activation = np.random.default_rng(1).uniform(0.0, 1.0, body.mj.nu)
    for value in (np.zeros(body.mj.nu), activation):
        mujoco.mj_resetDataKeyframe(body.mj, data, 0)
        data.act[:] = value
        mujoco.mj_forward(body.mj, data)
        forces.append(data.qfrc_actuator.copy())
    change = posture.coupling.T @ (forces[1] - forces[0])
    np.testing.assert_allclose(activation @ posture.torque, change, rtol=1e-6, atol=1e-6)


def test_excitations_of_a_torque_give_that_torque() -> None:
    posture = posture_of(LEGS)
    product = posture.excitation @ posture.torque
    strong = np.abs(posture.torque).sum(axis=0) > 100.0
    np.testing.assert_allclose(np.diag(product)[strong], 1.0, atol=0.05)
    assert ((posture.holding >= 0.0) & (posture.holding <= 1.0)).all()


def test_holding_the_posture_stands_longer_than_being_limp() -> None:
    environment = PushedBodyEnv(LEGS, push=0.0, disturbance=0.001)
    nothing = np.zeros((80, 38))
    held = play(environment, posture_of(LEGS).holding, nothing, seed=0)["time"]
    limp = play(environment, np.zeros(80), nothing, seed=0)["time"]
    assert held > limp


def test_reflexes_stand_longer_than_the_held_posture() -> None:
    environment = PushedBodyEnv(LEGS)
    holding = posture_of(LEGS).holding
    alone = np.mean([play(environment, holding, np.zeros((80, 38)), seed)["time"] for seed in (1, 2)])
    reflexes = []
    for gains in random_gains(LEGS, 3, np.random.default_rng(0)):
        per_observation, constant = reflex(LEGS, gains)
        reflexes += [play(environment, holding + constant, per_observation, seed)["time"] for seed in (1, 2)]
    assert np.mean(reflexes) > alone


def test_a_step_is_worth_one_for_standing_still_and_never_less_than_nothing() -> None:
    environment = PushedBodyEnv(LEGS, push=0.0)
    environment.reset(seed=0)
    rest = (2.0 * posture_of(LEGS).holding - 1.0).astype(np.float32)
    assert 0.9 < environment.step(rest)[1] <= 1.0
    environment.reset(seed=0)
    fallen, rewards = False, []
    while not fallen:
        _, reward, fallen, _, _ = environment.step(np.ones(80, np.float32))
        rewards.append(reward)
    assert 0.0 <= min(rewards) < max(rewards) < 0.9


def test_gains_are_drawn_within_their_ranges() -> None:
    low, high = gain_ranges("myofullbody")
    drawn = random_gains("myofullbody", 200, np.random.default_rng(0))
    table = np.array([[getattr(g, name) for name in ReflexGains.names()] for g in drawn])
    assert ((table >= low) & (table <= high)).all()
    assert (np.ptp(table, axis=0) > 0.9 * (high - low)).all()


def test_a_stretch_reflex_opposes_motion() -> None:
    body = load_body(LEGS)
    gains = ReflexGains(20.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    torques = posture_of(LEGS).torque.T @ reflex(LEGS, gains)[0]  # per observation
    n = len(body.joints)
    strong = np.abs(posture_of(LEGS).torque).sum(axis=0) > 100.0
    assert (np.diag(torques[:, :n])[strong] < 0).all()
    assert (np.diag(torques[:, n : 2 * n])[strong] < 0).all()


def test_a_leaning_reflex_does_nothing_where_the_centre_of_mass_is_to_be_held() -> None:
    per_observation, constant = reflex(LEGS, ReflexGains(20.0, 1.0, 800.0, 0.2, 300.0, 0.3, 0.02))
    held = np.zeros(38)
    held[-3] = 0.02  # m backwards
    np.testing.assert_allclose(per_observation @ held + constant, 0.0, atol=1e-12)
    assert np.abs(constant).max() > 0.001


def test_searches_may_leave_the_ranges_of_random_gains_and_keep_their_signs() -> None:
    (low, high), (least, most) = gain_ranges(LEGS), gain_limits(LEGS)
    assert (least < low).all()
    assert (most > high).all()
    assert ((least > 0) == (low > 0)).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"push": -0.1}, "push is -0.1"),
        ({"disturbance": np.nan}, "disturbance is nan"),
        ({"horizon": 0}, "horizon is 0"),
        ({"render_mode": "human"}, "render_mode is 'human'"),
    ],
)
def test_impossible_arguments(arguments: dict[str, float], message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        PushedBodyEnv(LEGS, **arguments)


def test_unknown_bodies_are_named() -> None:
    with pytest.raises(UnknownNameError, match="unknown body 'myodog'; valid names: myofullbody, myolegs"):
        PushedBodyEnv("myodog")
    with pytest.raises(UnknownNameError, match="unknown body"):
        gain_ranges("myodog")
