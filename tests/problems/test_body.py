"""The body after a push as a problem: units of its safety functions, reflexes as initial policies, synergies.

The legs stand for the whole body; both come out of the same code.
"""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.bodies.posture import posture_of
from hdsafebo.bodies.reflex import gain_ranges
from hdsafebo.errors import ProblemError
from hdsafebo.policies import GymnasiumPolicies
from hdsafebo.policies.episode import Episode
from hdsafebo.problems.body import (
    ReflexGainsProblem,
    body_policies,
    safety_functions,
    torque_synergies,
)
from hdsafebo.trials import Trials

LEGS = "myolegs"


@pytest.fixture(scope="module")
def legs() -> GymnasiumPolicies:
    return body_policies(LEGS, pushes=(1, 4), horizon=120, least_time=0.8, most_load=300.0)


def episode(steps: int, loads: list[float], *, terminated: bool = True) -> Episode:
    infos = [{"joint_load": load} for load in loads]
    return Episode(np.empty((steps, 1)), np.empty((steps, 1)), np.ones(steps), infos, terminated, 500)


def test_safety_functions_are_seconds_and_newton_metres() -> None:
    stands, load = safety_functions(1.7, 80.0)
    assert stands.of(episode(170, [0.0])) == 0.0
    assert stands.of(episode(160, [0.0])) == pytest.approx(-0.1 / 5.0)
    assert stands.of(episode(500, [0.0], terminated=False)) == pytest.approx(3.3 / 5.0)
    assert load.of(episode(2, [50.0, 75.0])) == 5.0
    assert load.of(episode(2, [90.0, 75.0])) == -10.0


def test_one_weight_per_muscle_and_observation(legs: GymnasiumPolicies) -> None:
    assert legs.policies.dimension == 80 * 39
    assert legs.features.matrix.shape == (64, 80 * 39)
    assert [s.name for s in legs.safety] == ["stands", "joint_load"]


def test_the_zero_policy_holds_the_posture(legs: GymnasiumPolicies) -> None:
    action = legs.policy(np.zeros(legs.policies.dimension))(np.zeros(38))
    np.testing.assert_allclose((action + 1.0) / 2.0, posture_of(LEGS).holding, atol=1e-6)


def test_initial_reflexes_differ_and_lie_within_the_box(legs: GymnasiumPolicies) -> None:
    x, _ = legs.initial(3, np.random.default_rng(0))
    assert (np.abs(x) <= legs.bounds[1]).all()
    assert np.ptp(legs.features(x), axis=0).max() > 0.01
    results = legs.evaluate(Trials.pending(x, x, 2))
    assert results.status()[0] != 2
    assert len(set(results.objective.tolist())) == 3


def test_a_reflex_of_given_gains_is_a_policy(legs: GymnasiumPolicies) -> None:
    problem = ReflexGainsProblem(legs, LEGS)
    gains = gain_ranges(LEGS).mean(axis=0)
    weights = problem.weights(gains)
    assert weights.shape == (legs.policies.dimension,)
    one = problem.evaluate(Trials.pending(gains[None], gains[None], 2))
    same = legs.evaluate(Trials.pending(weights[None], weights[None], 2))
    np.testing.assert_array_equal(one.objective, same.objective)
    np.testing.assert_array_equal(problem.bounds, gain_ranges(LEGS))


def test_torque_synergies_span_what_reflexes_do(legs: GymnasiumPolicies) -> None:
    codec = torque_synergies(legs, LEGS)
    joints = len(posture_of(LEGS).inertia)
    assert codec.dimension == joints * 39
    problem = ReflexGainsProblem(legs, LEGS)
    low, high = (problem.weights(limit) for limit in gain_ranges(LEGS))
    difference = (high - low)[None]
    np.testing.assert_allclose(codec.decode(codec.encode(difference)), difference, atol=1e-9)


def test_impossible_tasks_are_refused() -> None:
    with pytest.raises(ProblemError, match="steps is 170; expected at most the horizon, 100"):
        body_policies(LEGS, pushes=(1,), horizon=100)
