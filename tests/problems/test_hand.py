"""The hand as a problem: its two spaces, safety functions and kernel features."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import HandModelError
from hdsafebo.hand.policy import LinearPolicySpace
from hdsafebo.hand.reference import save_moment
from hdsafebo.hand.rollout import Scene, evaluate_policies
from hdsafebo.hand.synergies import Synergies, save_synergies
from hdsafebo.params import HandProblem, Params, parse_params
from hdsafebo.problem import check_problem
from hdsafebo.problems import hand as module
from hdsafebo.problems.hand import HandPolicies, behaviour_features, make_task, safety_functions
from hdsafebo.problems.registry import Task
from hdsafebo.trials import Status, Trials

SCENE = Scene("forearm", horizon=40)
BUDGET = {"initial": 4, "trials": 6, "batch": 1, "seeds": 1}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project whose synergies are random orthonormal directions."""
    directory = tmp_path_factory.mktemp("root")
    (directory / "models/synergies").mkdir(parents=True)
    hand = SCENE.simulation().hand
    rng = np.random.default_rng(0)
    basis = np.linalg.qr(rng.standard_normal((43, 10)))[0].T
    synergies = Synergies(
        np.full(43, 0.3), basis, np.linspace(0.1, 1, 10), hand.muscles, hand.variant, hand.digest
    )
    save_synergies(directory / module.SYNERGY_FILE, synergies)
    root_of_moment = rng.standard_normal((55, 55))
    save_moment(directory / module.MOMENT_FILE, root_of_moment @ root_of_moment.T, hand)
    return directory


@pytest.fixture(scope="module")
def params() -> Params:
    tasks = {
        "synthetic": {"budget": BUDGET, "methods": []},
        "hand": {"budget": BUDGET, "methods": []},
        "scs": {"budget": BUDGET, "methods": [], "tasks": []},
        "body": {"budget": BUDGET, "methods": []},
        "digits": {"budget": BUDGET, "methods": [], "tasks": []},
    }
    scene = {"variant": "forearm", "horizon": 40}
    return parse_params({"profile": "test", "hand": {"scene": scene}, "tasks": tasks, "methods": {}})


@pytest.fixture(scope="module")
def make(root: Path, params: Params) -> Callable[[str], Task]:
    return lambda name: make_task(name, params, seed=0, root=root)


def problem_of(task: Task) -> HandPolicies:
    assert isinstance(task.problem, HandPolicies)
    return task.problem


def test_spaces_and_bounds(make: Callable[[str], Task]) -> None:
    task = make("hand")
    problem = problem_of(task)
    check_problem(problem)
    assert problem.bounds.shape == (2, 43 * 55)
    assert task.latent_bounds is not None
    np.testing.assert_array_equal(task.latent_bounds, np.tile([[-1.0], [1.0]], (1, 5 * 55)))
    x, rows = problem.initial(3, np.random.default_rng(0))
    assert (rows == -1).all()
    assert (x >= problem.bounds[0]).all()
    assert (x <= problem.bounds[1]).all()
    corner = problem.codec.decode(np.sign(np.random.default_rng(1).standard_normal((200, 275))))
    assert np.abs(corner).max() <= problem.bounds[1].max() + 1e-12


def test_codes_come_back_and_distances_stay(make: Callable[[str], Task]) -> None:
    codec = problem_of(make("hand")).codec
    z = np.random.default_rng(0).uniform(-3, 3, (4, 275))
    np.testing.assert_allclose(codec.encode(codec.decode(z)), z, atol=1e-12)
    gap = codec.decode(z[:1]) - codec.decode(z[1:2])
    assert np.linalg.norm(gap) == pytest.approx(np.linalg.norm(z[0] - z[1]))


def test_evaluation_is_that_of_the_policy_over_synergies(make: Callable[[str], Task]) -> None:
    problem = problem_of(make("hand"))
    x, _ = problem.initial(4, np.random.default_rng(3))
    found = problem.evaluate(Trials.pending(x, x, 4))
    expected = evaluate_policies(SCENE, problem.space, x)
    np.testing.assert_array_equal(found.objective, expected.total_reward)
    np.testing.assert_array_equal(found.safety[:, 0], -expected.landing_speed)
    np.testing.assert_array_equal(found.safety[:, 1] >= 0, ~expected.dropped)
    np.testing.assert_array_equal(found.safety[:, 2], -expected.handling_speed)
    np.testing.assert_array_equal(found.safety[:, 3] >= 0, expected.upright)
    assert not found.failed.any()  # type: ignore[union-attr]
    again = problem.evaluate(Trials.pending(x, x, 4))
    np.testing.assert_array_equal(again.safety, found.safety)


def test_reported_safety_is_the_landing_speed(make: Callable[[str], Task]) -> None:
    problem = make("hand").problem
    values = np.array([[-4.39, -0.5, -5.0, -3.1], [-4.41, 1.0, 0.0, 0.1], [0.0, 1.0, -2.0, -0.2]])
    np.testing.assert_array_equal(problem.is_safe(values), [True, False, True])
    np.testing.assert_allclose(problem.violation(values), [0, 0.01, 0])


def test_what_is_modelled_depends_on_the_setting(make: Callable[[str], Task]) -> None:
    def modelled(name: str) -> list[str]:
        return [function.name for function in make(name).problem.safety if function.modelled]

    assert modelled("hand") == ["landing_speed"]
    assert modelled("hand_informed") == ["no_drop"]
    several = safety_functions(HandProblem(handling_limit=0.9), 4.4, ["no_drop", "handling_speed"])
    assert [(s.name, s.threshold, s.modelled) for s in several] == [
        ("landing_speed", -4.4, False),
        ("no_drop", 0.0, True),
        ("handling_speed", -0.9, True),
        ("upright", 0.0, False),
    ]


def test_what_is_given_is_what_is_said_to_be_given(make: Callable[[str], Task]) -> None:
    paper, informed = make("hand"), make("hand_informed")
    assert paper.knowledge.kernel_features is None
    assert paper.knowledge.extra_trials is None
    assert "landing_speed" in str(paper.knowledge.safety)
    assert "12 main directions" in str(informed.knowledge.kernel_features)
    assert "50 episodes" in str(informed.knowledge.extra_trials)
    assert set(informed.inputs) - set(paper.inputs) == {module.MOMENT_FILE}
    assert (paper.problem.name, informed.problem.name) == ("hand", "hand_informed")


def test_features_are_linear_and_only_in_the_informed_setting(make: Callable[[str], Task]) -> None:
    assert make("hand").problem.features is None
    features = make("hand_informed").problem.features
    assert features is not None
    x = np.random.default_rng(0).standard_normal((2, 43 * 55))
    assert features(x).shape == (2, 43 * 12)
    np.testing.assert_allclose(features(x[:1] - 2 * x[1:]), features(x)[:1] - 2 * features(x)[1:], atol=1e-9)


def test_feature_distance_is_the_behaviour_metric() -> None:
    rng = np.random.default_rng(0)
    half = rng.standard_normal((6, 6))
    features = behaviour_features(half @ half.T, 6)
    one, other = rng.standard_normal((2, 4, 6))
    gap = one - other
    distance = np.sum((features(one.reshape(1, -1)) - features(other.reshape(1, -1))) ** 2)
    assert distance == pytest.approx(np.trace(gap @ half @ half.T @ gap.T))


def test_no_initial_policy_ends_upright(make: Callable[[str], Task], monkeypatch: pytest.MonkeyPatch) -> None:
    """Draws that end upright, by a limit that half of these do, are replaced by the next ones."""
    from hdsafebo.hand import rollout

    problem = problem_of(make("hand"))
    drawn = problem.codec.decode(np.random.default_rng(5).uniform(-1, 1, (6, 275)))
    plain = evaluate_policies(SCENE, problem.space, drawn)
    monkeypatch.setattr(rollout, "UPRIGHT_TILT", float(np.median(plain.tilt[plain.in_hand])))
    upright = evaluate_policies(SCENE, problem.space, drawn).upright
    assert 0 < upright.sum() < 6
    x, _ = problem.initial(6, np.random.default_rng(5))
    np.testing.assert_array_equal(x[: (~upright).sum()], drawn[~upright])
    assert not evaluate_policies(SCENE, problem.space, x).upright.any()
    monkeypatch.setattr(rollout, "UPRIGHT_TILT", 4.0)
    monkeypatch.setattr(module, "_MOST_DRAWS", 2)
    with pytest.raises(HandModelError, match=r"only [01] of 2 random policies do not end upright"):
        problem.initial(2, np.random.default_rng(5))


def test_initial_policies_are_not_played_twice(
    make: Callable[[str], Task], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = problem_of(make("hand"))
    x, _ = problem.initial(3, np.random.default_rng(4))
    anew = problem_of(make("hand")).evaluate(Trials.pending(x, x, 4))
    monkeypatch.setattr(module, "evaluate_policies", None)
    found = problem.evaluate(Trials.pending(x, x, 4))
    np.testing.assert_array_equal(found.objective, anew.objective)
    np.testing.assert_array_equal(found.safety, anew.safety)
    np.testing.assert_array_equal(found.status(), anew.status())


def test_a_diverging_simulation_is_a_failed_trial(
    make: Callable[[str], Task], monkeypatch: pytest.MonkeyPatch
) -> None:
    from hdsafebo.hand import simulation

    monkeypatch.setattr(simulation, "MAX_JOINT_SPEED", 0.1)
    problem = make("hand").problem
    x, _ = problem.initial(2, np.random.default_rng(0))
    trials = Trials.pending(x, x, 4).with_results(problem.evaluate(Trials.pending(x, x, 4)))
    assert (trials.status == Status.FAILED).all()
    assert np.isnan(trials.objective).all()
    assert np.isnan(trials.safety).all()


def test_bad_input(make: Callable[[str], Task], params: Params, tmp_path: Path) -> None:
    problem = make("hand").problem
    with pytest.raises(HandModelError, match=r"expected \(n, 2365\): 43 x 55 weights"):
        problem.evaluate(Trials.pending(np.zeros((1, 3575)), np.zeros((1, 3575)), 4))
    with pytest.raises(HandModelError, match="cannot be read as synergies"):
        make_task("hand", params, seed=0, root=tmp_path)


def test_paper_size(root: Path) -> None:
    hand = Scene("extended").simulation()
    space = LinearPolicySpace(np.full(55, 0.3), np.eye(55)[:5], hand.observer.size)
    problem = HandPolicies(Scene("extended"), space, 3.0, safety_functions(HandProblem(), 4.4, ["no_drop"]))
    assert problem.bounds.shape == (2, 3575)
    assert problem.codec.space.dimension == 325
