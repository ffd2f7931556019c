"""The body after a push as a problem: units of its safety functions, reflexes as initial policies, synergies.

The legs stand for the whole body; both come out of the same code.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hdsafebo.bodies.posture import posture_of
from hdsafebo.bodies.reflex import gain_limits, gain_ranges
from hdsafebo.errors import ParamsError, ProblemError, UnknownNameError
from hdsafebo.files.yaml import parse_mapping
from hdsafebo.optimizers.local.constrained.chart import VisibleSteps
from hdsafebo.optimizers.local.constrained.search import ConstrainedSearch
from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
from hdsafebo.params import Params, parse_params
from hdsafebo.pipeline.profiles import profile_text
from hdsafebo.policies import GymnasiumPolicies
from hdsafebo.policies.episode import Episode
from hdsafebo.problems.body import (
    RECORDED_FILE,
    body_policies,
    load_observations,
    make_task,
    safety_functions,
    save_observations,
    sustained,
    torque_synergies,
)
from hdsafebo.problems.body_replay import beside, outcome_of, strip, weights_of
from hdsafebo.problems.reflexes import ReflexGainsProblem
from hdsafebo.trials import Trials

LEGS = "myolegs"


@pytest.fixture(scope="module")
def legs() -> GymnasiumPolicies:
    return body_policies(LEGS, pushes=(1, 4), horizon=120, least_time=0.8, most_load=300.0)


def episode(steps: int, loads: list[float], *, terminated: bool = True) -> Episode:
    infos = [{"joint_load": load} for load in loads]
    return Episode(np.empty((steps, 1)), np.empty((steps, 1)), np.ones(steps), infos, terminated, 500)


def test_safety_functions_are_seconds_and_newton_metres() -> None:
    stands, load = safety_functions(1.4, 60.0)
    assert stands.of(episode(140, [0.0])) == 0.0
    assert stands.of(episode(130, [0.0])) == pytest.approx(-0.1 / 5.0)
    assert stands.of(episode(500, [0.0], terminated=False)) == pytest.approx(3.6 / 5.0)
    assert load.of(episode(2, [50.0, 60.0])) == 5.0
    assert load.of(episode(2, [80.0, 70.0])) == -15.0


def test_a_load_counts_where_it_lasts() -> None:
    spike = [10.0] * 50 + [110.0] + [10.0] * 50
    assert sustained(spike) == pytest.approx(20.0)
    assert sustained([*spike, *([70.0] * 10)]) == pytest.approx(70.0)
    assert sustained([]) == 0.0


def test_one_weight_per_muscle_and_observation(legs: GymnasiumPolicies) -> None:
    assert legs.policies.dimension == 80 * 39
    assert legs.features.matrix.shape == (8, 80 * 39)
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
    np.testing.assert_array_equal(problem.bounds, gain_limits(LEGS))


def test_kernel_inputs_see_nearly_all_in_which_reflexes_differ(legs: GymnasiumPolicies) -> None:
    """So `hdsafebo_local` searches what they see by constrained ascents, and leaves the rest alone."""
    optimizer = HdSafeBOLocal(legs, seed=0)
    known = legs.initial_trials(8, seed=0)
    optimizer.observe(known.x, known.objective, known.safety, status=known.status, initial=True)
    search = optimizer.search
    assert isinstance(search, ConstrainedSearch)
    assert isinstance(search.chart, VisibleSteps)


def test_torque_synergies_span_what_reflexes_do(legs: GymnasiumPolicies) -> None:
    codec = torque_synergies(legs, LEGS)
    joints = len(posture_of(LEGS).inertia)
    assert codec.dimension == joints * 39
    problem = ReflexGainsProblem(legs, LEGS)
    low, high = (problem.weights(limit) for limit in gain_ranges(LEGS))
    difference = (high - low)[None]
    np.testing.assert_allclose(codec.decode(codec.encode(difference)), difference, atol=1e-9)


def test_impossible_tasks_are_refused() -> None:
    with pytest.raises(ProblemError, match="steps is 140; expected at most the horizon, 100"):
        body_policies(LEGS, pushes=(1,), horizon=100)


def test_recorded_observations_give_the_same_problem(legs: GymnasiumPolicies, tmp_path: Path) -> None:
    path = tmp_path / "observations.npz"
    save_observations(legs.observations, path)
    again = body_policies(
        LEGS, (1, 4), horizon=120, least_time=0.8, most_load=300.0, recorded=load_observations(path)
    )
    np.testing.assert_array_equal(again.features.matrix, legs.features.matrix)
    np.testing.assert_array_equal(again.bounds, legs.bounds)
    with pytest.raises(ProblemError, match=r"observations of shape \(4, 3\) for .*expected \(n, 38\)"):
        body_policies(LEGS, (1,), horizon=120, least_time=0.8, recorded=np.zeros((4, 3)))
    with pytest.raises(ProblemError, match="not finite"):
        body_policies(LEGS, (1,), horizon=120, least_time=0.8, recorded=np.full((4, 38), np.nan))


def test_missing_and_damaged_recordings_name_the_stage(tmp_path: Path) -> None:
    path = tmp_path / "observations.npz"
    with pytest.raises(ProblemError, match="run the stage record_body"):
        load_observations(path)
    path.write_bytes(b"no archive")
    with pytest.raises(ProblemError, match="run the stage record_body"):
        load_observations(path)


@pytest.fixture(scope="module")
def smoke(project_root: Path) -> Params:
    return parse_params(parse_mapping(profile_text(project_root, "smoke"), "smoke", ParamsError))


def test_the_task_has_three_spaces(smoke: Params, tmp_path: Path) -> None:
    settings = smoke.tasks.body.problem
    save_observations(np.random.default_rng(0).standard_normal((50, 38)), tmp_path / RECORDED_FILE)
    task = make_task("body", smoke, seed=0, root=tmp_path)
    assert task.embedding is None
    assert task.problem.bounds.shape == (2, 80 * 39)
    torques, gains = task.spaces["torques"], task.spaces["gains"]
    assert torques.embedding is not None
    joints = len(posture_of(LEGS).inertia)
    x, _ = task.problem.initial(2, np.random.default_rng(0))
    assert torques.embedding(x).encode(x).shape == (2, joints * 39)
    assert gains.problem.bounds.shape == (2, 7)
    drawn, _ = gains.problem.initial(5, np.random.default_rng(0))
    assert ((drawn >= gains.problem.bounds[0]) & (drawn <= gains.problem.bounds[1])).all()
    assert f"{joints * 39:,} weights" in task.knowledge.given()["latent_space"]
    assert task.knowledge == torques.knowledge == gains.knowledge
    assert [s.name for s in task.problem.safety] == [s.name for s in gains.problem.safety]
    assert settings.least_time == 0.4
    with pytest.raises(UnknownNameError, match="body_informed"):
        make_task("body_informed", smoke, seed=0, root=tmp_path)


def test_a_point_of_every_space_is_played_again_as_it_was(legs: GymnasiumPolicies, smoke: Params) -> None:
    settings = smoke.tasks.body.problem
    gains = gain_ranges(LEGS).mean(axis=0)
    weights = weights_of(settings, legs, gains, "gains")
    outcome = outcome_of(legs, weights, (1, 4))
    result = ReflexGainsProblem(legs, LEGS).evaluate(Trials.pending(gains[None], gains[None], 2))
    assert outcome.total == result.objective[0]
    assert 300.0 - max(outcome.loads) == pytest.approx(result.safety[0, 1])
    assert min(outcome.seconds) == pytest.approx(0.8 + 1.2 * result.safety[0, 0])
    codes = torque_synergies(legs, LEGS).encode(weights[None])[0]
    through = weights_of(settings, legs, codes, "torques")
    np.testing.assert_allclose(legs.features(through[None]), legs.features(weights[None]), atol=0.5)
    assert weights_of(settings, legs, weights, "original") is weights


def test_single_precision_plays_the_same_episode(legs: GymnasiumPolicies) -> None:
    kept, _ = legs.initial(1, np.random.default_rng(3))
    np.testing.assert_array_equal(kept, kept.astype(np.float32))
    x = kept * (1.0 + 1e-9)
    np.testing.assert_array_equal(legs.play(x[0])[0].rewards, legs.play(kept[0])[0].rewards)


def test_pictures_side_by_side() -> None:
    frames = [np.full((8, 16, 3), k, np.uint8) for k in range(9)]
    assert strip(frames).shape == (4, 5 * 4, 3)
    assert strip(frames)[0, ::4, 0].tolist() == [0, 2, 4, 6, 8]
    both = beside(frames, frames[:2])
    assert len(both) == 9
    assert both[-1].shape == (8, 16, 3)
    assert both[-1][0, [0, -1], 0].tolist() == [8, 1]
