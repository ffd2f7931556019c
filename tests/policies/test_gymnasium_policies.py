"""Safe search over policies of an environment: evaluation, recording, features, and clear refusals."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np
import pytest

from hdsafebo import GymnasiumPolicies, HdSafeBOLocal, budget, gaussian_design, lasts, survives
from hdsafebo.errors import PolicyFileError, ProblemError, RenderingUnavailableError
from hdsafebo.files.atomic import WriteError
from hdsafebo.policies.making import on_a_grid
from hdsafebo.policies.policy_file import load_policy
from hdsafebo.problem import LinearFeatures
from hdsafebo.trials import Status, Trials
from policies.toy_environments import Point, make_point


def problem(**arguments: Any) -> GymnasiumPolicies:
    settings: dict[str, Any] = {"horizon": 20, "seeds": (1, 2), "design": gaussian_design(0.1, 1.0)}
    safety = arguments.pop("safety", [budget("distance", 60.0)])
    return GymnasiumPolicies(make_point, safety, **(settings | arguments))


def trials(x: np.ndarray, functions: int = 1) -> Trials:
    return Trials.pending(x, x, functions)


def test_objective_is_the_mean_return_and_safety_the_least_over_seeds() -> None:
    p = problem()
    x, rows = p.initial(3, np.random.default_rng(0))
    assert (rows == -1).all()
    results = p.evaluate(trials(x))
    for k in range(3):
        episodes = p.play(x[k])
        assert results.objective[k] == np.mean([e.total_reward for e in episodes])
        assert results.safety[k, 0] == min(60.0 - sum(info["distance"] for info in e.infos) for e in episodes)
    assert results.failed is not None
    assert not results.failed.any()
    assert results.reasons == (None,) * 3


def test_an_episode_is_what_the_policy_did_by_hand() -> None:
    p = problem(seeds=(3,))
    x = np.random.default_rng(0).normal(0.0, 0.3, p.policies.dimension)
    [episode] = p.play(x)
    environment, act = Point(), p.policy(x).as_function()
    observation, _ = environment.reset(seed=3)
    total = 0.0
    for k in range(20):
        np.testing.assert_array_equal(episode.observations[k], observation.astype(float))
        observation, reward, *_ = environment.step(act(observation))
        total += reward
    assert episode.total_reward == pytest.approx(total, rel=1e-12)


def test_results_do_not_depend_on_processes_order_or_batch() -> None:
    x, _ = problem().initial(5, np.random.default_rng(0))
    here = problem().evaluate(trials(x))
    for workers in (1, 2):
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as executor:
            there = problem(executor=executor).evaluate(trials(x))
        np.testing.assert_array_equal(there.objective, here.objective)
        np.testing.assert_array_equal(there.safety, here.safety)
    backwards = problem().evaluate(trials(x[::-1]))
    np.testing.assert_array_equal(backwards.objective[::-1], here.objective)
    assert problem().evaluate(trials(x[2:3])).objective[0] == here.objective[2]


def test_what_worker_processes_cannot_be_told_of_is_refused_by_name() -> None:
    p = GymnasiumPolicies(lambda: Point(), [survives()], horizon=20)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        p.executor = executor
        with pytest.raises(ProblemError, match="cannot be made in worker processes"):
            p.play(np.zeros(p.policies.dimension))


def test_observations_are_normalised_by_recorded_ones() -> None:
    p = problem()
    seen = p.recorded[:, :-1]
    np.testing.assert_allclose(seen.mean(axis=0), 0.0, atol=1e-9)
    assert seen.std(axis=0).max() == pytest.approx(1.0)
    assert (p.recorded[:, -1] == 1.0).all()


def test_distance_of_features_is_the_difference_of_actions() -> None:
    p = problem(directions=5)
    a, b = np.random.default_rng(0).normal(size=(2, p.policies.dimension))
    difference = (a - b).reshape(2, -1)
    expected = np.mean(np.sum((p.recorded @ difference.T) ** 2, axis=1))
    features = p.features(np.stack([a, b]))
    assert np.sum((features[0] - features[1]) ** 2) == pytest.approx(expected)
    np.testing.assert_allclose(features, np.stack([a, b]) @ p.features.matrix.T)


def test_fewer_directions_are_the_main_ones() -> None:
    full, few = problem(directions=5), problem(directions=2)
    assert full.features.matrix.shape == (10, 10)
    assert few.features.matrix.shape == (4, 10)
    kept = np.linalg.norm(few.features.matrix) ** 2 / np.linalg.norm(full.features.matrix) ** 2
    assert 0.3 < kept < 1.0


def test_directions_hold_most_of_what_was_recorded() -> None:
    p = problem()
    kept = len(p.features.matrix) // p.policies.actions
    values = np.linalg.eigvalsh(p.recorded.T @ p.recorded)[::-1]
    assert values[:kept].sum() >= 0.95 * values.sum() > values[: kept - 1].sum()


def test_the_same_arguments_make_the_same_problem() -> None:
    one, other = problem(), problem()
    np.testing.assert_array_equal(one.features.matrix, other.features.matrix)
    assert one.policies.normalisation.mean.tolist() == other.policies.normalisation.mean.tolist()
    assert problem(recording_seed=1).features.matrix.tolist() != one.features.matrix.tolist()


def test_raw_gains_become_weights() -> None:
    p = problem()
    gain = np.array([[-0.4, 0.0, -0.5, 0.0], [0.0, -0.6, 0.0, -0.5]])
    policy = p.policy(p.policies.weights_of(gain, np.array([0.1, 0.0])))
    observation = p.policies.normalisation.mean + 0.5 * p.policies.normalisation.scale
    np.testing.assert_allclose(
        policy(observation), np.clip(gain @ observation + [0.1, 0.0], -1.0, 1.0), rtol=1e-5
    )


def test_a_box_from_the_design_holds_it() -> None:
    p = problem(box="design")
    x, _ = p.initial(200, np.random.default_rng(5))
    inside = (np.abs(x) < p.bounds[1]).mean()
    assert inside > 0.98
    assert p.bounds[1].min() >= 0.03


def test_synergies_are_an_embedding() -> None:
    p = problem()
    codec = p.synergies([[1.0, 1.0]], centre=np.full(10, 0.1))
    z = np.random.default_rng(0).normal(size=(3, codec.dimension))
    np.testing.assert_allclose(codec.encode(codec.decode(z)), z)
    np.testing.assert_allclose(np.diff(codec.decode(z).reshape(3, 2, 5) - 0.1, axis=1), 0.0, atol=1e-12)
    composed = p.features(codec.decode(z)) - p.features(codec.decode(np.zeros_like(z)))
    np.testing.assert_allclose(z @ codec.compose(p.features.matrix).T, composed, atol=1e-12)


# --- safety functions


def test_survival_is_graded() -> None:
    p = problem(arguments={"fault": "falls"}, safety=[survives(), lasts(5), lasts(10, name="longer")])
    [safety] = p.evaluate(trials(np.zeros((1, 10)), 3)).safety
    np.testing.assert_allclose(safety, [-14 / 20, 2 / 20, -3 / 20])
    [standing] = problem(safety=[survives(), lasts(20)]).evaluate(trials(np.zeros((1, 10)), 2)).safety
    np.testing.assert_allclose(standing, [1.0, 0.0])


def test_a_budget_counts_what_info_reports() -> None:
    functions = [budget("cost", 12.0), budget("distance", 3.0, reduce=max)]
    [safety] = problem(safety=functions).evaluate(trials(np.zeros((1, 10)), 2)).safety
    assert safety[0] == 2.0
    assert safety[1] > 0.0


def test_a_budget_of_an_unknown_key_names_the_known_ones() -> None:
    with pytest.raises(ProblemError, match=r"info\['costs'\].*keys are: cost, distance"):
        problem(safety=[budget("costs", 1.0)])


def test_a_safety_function_that_gives_no_number_is_named() -> None:
    from hdsafebo import EpisodeSafety, Safety

    with pytest.raises(ProblemError, match="safety function 'own' gave nan"):
        problem(safety=[EpisodeSafety(Safety("own", 0.0), lambda episode: float("nan"))])


# --- policies


def test_a_policy_comes_back_from_its_file(tmp_path: Any) -> None:
    p = problem()
    x = np.random.default_rng(1).normal(size=10).astype(np.float32).astype(float)
    p.save_policy(x, tmp_path / "policy.safetensors")
    np.testing.assert_array_equal(p.load_policy(tmp_path / "policy.safetensors"), x)
    loaded, observation = load_policy(tmp_path / "policy.safetensors"), np.arange(4.0)
    np.testing.assert_array_equal(loaded(observation), p.policy(x)(observation))


def test_policies_of_other_problems_are_refused(tmp_path: Any) -> None:
    import gymnasium

    file = tmp_path / "policy.safetensors"
    other = GymnasiumPolicies(lambda: gymnasium.make("Pendulum-v1"), [survives()])
    other.save_policy(np.zeros(other.policies.dimension), file)
    with pytest.raises(PolicyFileError, match=r"actions \(1,\) and observations \(3,\)"):
        problem().load_policy(file)
    problem(recording_seed=1).save_policy(np.zeros(10), file)
    with pytest.raises(PolicyFileError, match="normalisation of the policy is not that"):
        problem().load_policy(file)
    file.write_bytes(b"no policy")
    with pytest.raises(PolicyFileError, match="cannot be read as a policy"):
        problem().load_policy(file)
    with pytest.raises(PolicyFileError, match="cannot be read"):
        problem().load_policy(tmp_path / "missing.safetensors")


def test_a_policy_that_cannot_be_written_says_where(tmp_path: Any) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(WriteError, match="file"):
        problem().save_policy(np.zeros(10), tmp_path / "file" / "policy.safetensors")


def test_predict_is_that_of_stable_baselines(tmp_path: Any) -> None:
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.monitor import Monitor

    p = problem(seeds=(0,))
    policy = p.policy(np.random.default_rng(1).normal(0.0, 0.3, 10))
    batch = np.random.default_rng(2).normal(size=(6, 4))
    actions, state = policy.predict(batch)
    assert state is None
    assert actions.dtype == np.float32
    for row, action in zip(batch, actions, strict=True):
        np.testing.assert_array_equal(policy(row), action)
    mean, _ = evaluate_policy(policy, Monitor(Point()), n_eval_episodes=2)
    assert np.isfinite(mean)
    with pytest.raises(ProblemError, match=r"observation of shape \(5,\)"):
        policy(np.zeros(5))


def test_the_exported_function_needs_numpy_alone() -> None:
    policy = problem().policy(np.random.default_rng(1).normal(size=10))
    act = policy.as_function()
    for observation in np.random.default_rng(2).normal(size=(5, 4)):
        np.testing.assert_allclose(act(observation), policy(observation), rtol=1e-6)
    assert set(act.__globals__) & {"hdsafebo", "PolicySpace"} <= {"PolicySpace"}


def test_a_video_shows_the_episode(tmp_path: Any) -> None:
    p = problem()
    x = np.zeros(10)
    episode = p.video(x, tmp_path / "point.mp4", seed=1)
    assert episode.total_reward == p.play(x, seeds=(1,))[0].total_reward
    assert (tmp_path / "point.mp4").read_bytes()[4:8] == b"ftyp"


class Blind(Point):
    """It takes no render mode."""

    def __init__(self) -> None:
        super().__init__()


def test_an_environment_that_cannot_draw_says_so(tmp_path: Any) -> None:
    p = GymnasiumPolicies(Blind, [survives()], horizon=20)
    with pytest.raises(RenderingUnavailableError, match=r"'Blind' makes no pictures.*render_mode"):
        p.video(np.zeros(10), tmp_path / "none.mp4")
    assert not (tmp_path / "none.mp4").exists()


# --- failures are trials, mistakes are errors


def test_a_raising_environment_is_a_failed_trial_with_its_reason() -> None:
    p = problem(arguments={"fault": "raises_on_strong"}, design=gaussian_design(0.01, 0.05))
    weak, strong = np.zeros(10), np.full(10, 1.0)
    results = p.evaluate(trials(np.stack([weak, strong, weak])))
    assert results.status().tolist() == [Status.COMPLETED, Status.FAILED, Status.COMPLETED]
    assert results.reasons is not None
    assert "RuntimeError" in str(results.reasons[1])
    assert "the motor is hot" in str(results.reasons[1])
    assert results.objective[0] == results.objective[2]


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("discrete", "action space .* is Discrete; expected a Box"),
        ("dict", "observation space .* is Dict; expected a Box.*FlattenObservation"),
        ("unbounded", "actions .* are not bounded"),
        ("whole", "actions .* have type int64; expected floats"),
        ("nan", "none of 10 initial policies .* gives a result: observation 1 is nan"),
        ("nan_reward", "gives a result: reward is nan after 1 steps"),
        ("text", "gives a result: ProblemError after 0 steps: observation: '1_0' is text"),
        ("text_reward", "gives a result: ProblemError after 0 steps: reward: '1_0' is text"),
        ("raises", "gives a result: RuntimeError .* the motor is hot"),
        ("says_so", "gives a result: diverged: out of this world"),
        ("no_seed", "seeds 1 and 2 .* give the same episodes"),
        ("forgetful", "another episode when it is played again with seed 1"),
    ],
)
def test_environments_that_cannot_be_searched(fault: str, message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        problem(arguments={"fault": fault})


def no_environment() -> object:
    return object()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"horizon": 0}, "horizon is 0"),
        ({"seeds": ()}, "seeds are .*at least one"),
        ({"seeds": (1, 1)}, "all different"),
        ({"seeds": (-1,)}, "at least 0"),
        ({"box": "large"}, "box is 'large'"),
        ({"box": [1.0, 2.0]}, r"box has shape \(2,\)"),
        ({"box": ["1_0"]}, "box: '1_0' is text"),
        ({"base": "1_0"}, "base: '1_0' is text"),
        ({"unit": np.array(["1_0"], object)}, "unit: '1_0' is text"),
        ({"box": 0.0}, "above 0"),
        ({"base": np.zeros(3)}, r"base has shape \(3,\)"),
        ({"unit": 0.0}, "unit has values that are not above 0"),
        ({"directions": 0}, "directions is 0"),
        ({"moves": 0}, "moves is 0; expected 1 to 99"),
        ({"moves": 4, "effects": np.ones((2, 3))}, r"effects have shape \(2, 3\); expected \(q, 2\)"),
        ({"recorded": 0}, "recorded is 0"),
        ({"design": lambda space, n, rng: np.zeros((n, 3))}, r"gave policies of shape \(10, 3\)"),
        ({"arguments": {"wheels": 4}}, "cannot be made with .wheels=4."),
        ({"safety": []}, "no modelled safety function"),
    ],
)
def test_impossible_arguments(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        problem(**arguments)


def test_what_is_no_environment_is_said() -> None:
    with pytest.raises(ProblemError, match="'Nowhere-v0' cannot be made"):
        GymnasiumPolicies("Nowhere-v0", [survives()])
    with pytest.raises(ProblemError, match="has no reset"):
        GymnasiumPolicies(no_environment, [survives()])


def test_a_horizon_of_none_is_asked_for() -> None:
    class Endless(Point):
        def __init__(self) -> None:
            super().__init__()
            del self.horizon

    with pytest.raises(ProblemError, match=r"has no limit of steps; pass horizon"):
        GymnasiumPolicies(Endless, [survives()])


def test_features_of_another_environment_are_refused() -> None:
    p = problem()
    p.features = LinearFeatures(np.zeros((4, 7)))
    with pytest.raises(ProblemError, match=r"features .*\(4, 7\).*expected \(p, 10\)"):
        HdSafeBOLocal(p, seed=0)


def test_policies_of_a_wrong_shape() -> None:
    p = problem()
    with pytest.raises(ProblemError, match=r"policy of shape \(9,\); expected \(10,\): 2 actions x"):
        p.policy(np.zeros(9))
    with pytest.raises(ProblemError, match="1 weights that are not finite"):
        p.policy([np.nan] + [0.0] * 9)


def test_the_search_improves_safely() -> None:
    p = problem(safety=[budget("distance", 40.0)])
    known = p.initial_trials(15, seed=0)
    optimizer = HdSafeBOLocal(p, seed=0)
    optimizer.observe(known.x, known.objective, known.safety, status=known.status, initial=True)
    before = optimizer.best()
    assert before is not None
    for _ in range(5):
        asked = optimizer.ask(5)
        results = p.evaluate(asked)
        optimizer.tell(asked, results.objective, results.safety, status=results.status())
    after = optimizer.best()
    assert after is not None
    assert after.objective > before.objective
    assert optimizer.feasible[~optimizer.trials.initial].mean() >= 0.9


def test_limits_on_a_grid_are_hardly_wider() -> None:
    limit = np.array([0.03, 0.5, 1.0, 0.7013])
    bounds, resolution = on_a_grid(np.stack([-limit, limit]))
    np.testing.assert_array_equal(np.frexp(resolution)[0], 0.5)
    steps = bounds[1] / resolution
    np.testing.assert_array_equal(steps, np.rint(steps))
    assert ((steps > 256) & (steps <= 512)).all()
    assert ((bounds[1] >= limit) & (bounds[1] <= 1.004 * limit)).all()
    np.testing.assert_array_equal(bounds[0], -bounds[1])


def test_many_weights_have_a_resolution(monkeypatch: pytest.MonkeyPatch) -> None:
    assert problem().resolution is None
    monkeypatch.setattr("hdsafebo.policies.problem._MANY_WEIGHTS", 5)
    p = problem()
    assert p.resolution is not None
    x, _ = p.initial(4, np.random.default_rng(0))
    np.testing.assert_array_equal(x / p.resolution, np.rint(x / p.resolution))
