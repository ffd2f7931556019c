"""What is refused, and that a refusal loses nothing."""

import numpy as np
import pytest

from hdsafebo.errors import NoSafePointError, ParamsError, ProblemError, TrialError
from hdsafebo.optimizers.baselines.config import Config
from hdsafebo.optimizers.baselines.linebo import LineBO
from hdsafebo.optimizers.hdsafebo import HdSafeBO
from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
from hdsafebo.problem import FunctionProblem, Safety
from optimizers.toy import bowl, bowl_problem, observe_initial, rows_problem, run_rounds

METHODS = [HdSafeBO, HdSafeBOLocal]
NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("objective", "safety", "message"),
    [
        ([NAN, 0.0], [0.0, 0.0], "objective is nan for trial number 0"),
        ([0.0, -INF], [0.0, 0.0], "objective is -inf for trial number 1"),
        ([0.0, 0.0], [0.0, NAN], "safety 'distance' is nan for trial number 1"),
        ([0.0, 0.0], [INF, 0.0], "safety 'distance' is inf"),
        ([0.0], [0.0, 0.0], r"objective has shape \(1,\); expected \(2,\)"),
        ([0.0, 0.0], [0.0], r"safety has shape \(1, 1\); expected \(2, 1\)"),
        ([0.0, 0.0], [[0.0, 1.0], [0.0, 1.0]], r"safety has shape \(2, 2\); expected \(2, 1\).*distance"),
        ([[0.0, 0.0]], [0.0, 0.0], r"objective has shape \(1, 2\)"),
        (["a", 0.0], [0.0, 0.0], "objective is not an array of numbers"),
        ([0.0, None], [0.0, 0.0], "objective is nan|objective is not an array"),
        ([0.0, 0.0], None, "safety"),
    ],
)
def test_results(objective, safety, message: str) -> None:
    made = HdSafeBO(bowl_problem())
    observe_initial(made)
    trials = made.ask(2)
    with pytest.raises(TrialError, match=message):
        made.tell(trials, objective, safety)
    assert made.trials.completed.sum() == 12
    with pytest.raises(TrialError, match=message):
        made.observe(np.zeros((2, 4)), objective, safety)
    assert len(made.trials) == 14
    made.tell(trials, *bowl(trials.x))
    assert made.trials.completed.all()


@pytest.mark.parametrize(
    ("ids", "message"),
    [
        ([99], r"unknown trials \[99\]; known are the ids 0 to 13"),
        ([-1], r"unknown trials \[-1\]"),
        ([12.0], "list of their ids"),
        (["x"], "list of their ids"),
        ([[12]], "list of their ids"),
    ],
)
def test_unknown_trials(ids, message: str) -> None:
    made = HdSafeBO(bowl_problem())
    observe_initial(made)
    made.ask(2)
    with pytest.raises(TrialError, match=message):
        made.tell(ids, [0.0], [0.0])


def test_changed_inputs_are_not_taken_for_the_proposed_ones() -> None:
    made = HdSafeBO(bowl_problem())
    observe_initial(made)
    trials = made.ask(2)
    trials.x[1] += 0.1
    with pytest.raises(TrialError, match=r"inputs of trials \[13\] differ .* observe"):
        made.tell(trials, [0.0, 0.0], [0.0, 0.0])


def test_asked_trials_are_the_callers_own_copy() -> None:
    made = HdSafeBO(bowl_problem())
    observe_initial(made)
    trials = made.ask(2)
    kept = made.trials.x.copy()
    trials.x[:] = 7.0
    np.testing.assert_array_equal(made.trials.x, kept)


@pytest.mark.parametrize("status", [0, 7, [1, 0], [1, 1, 1], ["ok", "ok"]])
def test_status(status) -> None:
    made = HdSafeBO(bowl_problem())
    observe_initial(made)
    trials = made.ask(2)
    with pytest.raises(TrialError, match="status"):
        made.tell(trials, [0.0, 0.0], [0.0, 0.0], status=status)


@pytest.mark.parametrize(
    ("x", "message"),
    [
        ([[NAN, 0, 0, 0]], r"NaN or infinite values in rows \[0\]"),
        ([[INF, 0, 0, 0]], "infinite"),
        ([[0.0, 0.0]], r"x has shape \(1, 2\); expected \(n, 4\)"),
        ([0.0, 0.0, 0.0, 0.0], r"x has shape \(4,\)"),
    ],
)
def test_inputs(x, message: str) -> None:
    with pytest.raises(TrialError, match=message):
        HdSafeBO(bowl_problem()).observe(x, [0.0], [0.0])


@pytest.mark.parametrize("rows", [[50], [-2], [0.5], [0, 1]])
def test_candidate_rows(rows) -> None:
    with pytest.raises(TrialError, match="candidate"):
        HdSafeBO(rows_problem(50)).observe([[0.0, 0.0]], [0.0], [0.0], candidate=rows)


@pytest.mark.parametrize("n", [0, -1, 1.5, True, "3", None])
def test_batch_sizes(n) -> None:
    made = HdSafeBO(bowl_problem())
    observe_initial(made)
    with pytest.raises(TrialError, match="whole number of trials"):
        made.ask(n)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"beat": 2.0}, "method 'hdsafebo': unknown setting 'beat'; valid settings: .*beta"),
        ({"beta": "2"}, "setting 'beta'.*got '2'"),
        ({"beta": NAN}, "setting 'beta'"),
        ({"alpha": 1.0}, "setting 'alpha'"),
        ({"alpha": 0.9, "beta": 2.0}, "alpha .* and beta .* set the same thing"),
        ({"empty_safe_set": "ignore"}, "setting 'empty_safe_set'.*'mark' or 'abstain'"),
        ({"candidates": 0}, "setting 'candidates'"),
    ],
)
def test_settings(settings: dict, message: str) -> None:
    with pytest.raises(ParamsError, match=message):
        HdSafeBO(bowl_problem(), **settings)


def test_alpha_stands_for_its_beta() -> None:
    assert HdSafeBO(bowl_problem(), alpha=0.97725).settings.confidence == pytest.approx(-2.0, abs=1e-4)


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        (np.zeros((2, 4)), "zero width in all 4 dimensions"),
        (np.stack([np.ones(4), np.zeros(4)]), "lower bound above upper bound"),
        (np.stack([np.zeros(4), np.full(4, NAN)]), "not finite"),
    ],
)
def test_boxes(bounds, message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        HdSafeBO(bowl_problem(), bounds=bounds)


def test_problem_without_safety_function() -> None:
    with pytest.raises(ProblemError, match="no modelled safety function"):
        FunctionProblem(bowl, bowl_problem().bounds, [Safety("s", 0.0, modelled=False)])
    with pytest.raises(ProblemError, match="threshold of safety function 's' is nan"):
        Safety("s", NAN)


@pytest.mark.parametrize("method", METHODS)
def test_a_dimension_of_zero_width_stays_fixed(method) -> None:
    bounds = np.stack([np.zeros(4), np.ones(4)])
    bounds[:, 2] = 0.4
    made = method(FunctionProblem(bowl, bounds, [Safety("distance", 0.0)]))
    observe_initial(made)
    run_rounds(made, 3)
    np.testing.assert_array_equal(made.trials.x[:, 2], 0.4)


@pytest.mark.parametrize("method", [HdSafeBO, HdSafeBOLocal, Config, LineBO])
def test_safety_is_judged_where_a_dimension_of_zero_width_is_fixed(method) -> None:
    """Initial trials vary in the fixed dimension, so what is believed depends on where it is fixed."""
    bounds = np.stack([np.zeros(4), np.ones(4)])
    bounds[:, 2] = 0.4
    for seed in range(3):
        made = method(bowl_problem(), bounds=bounds, seed=seed, beta=-1.0)
        observe_initial(made, seed=seed)
        trials = made.ask(8)
        np.testing.assert_array_equal(trials.z[:, 2], 0.4)
        inputs = made.kernel_inputs(trials[~trials.marked_unsafe])
        assert made.surrogate.believed_safe(inputs, made.settings.confidence).all()


@pytest.mark.parametrize("method", METHODS)
def test_threshold_that_no_initial_point_meets(method) -> None:
    made = method(bowl_problem(threshold=10.0), empty_safe_set="abstain")
    observe_initial(made)
    with pytest.raises(NoSafePointError, match="none of the 12 completed trials meets distance >= 10"):
        made.ask(3)
    made = method(bowl_problem(threshold=10.0), empty_safe_set="mark")
    observe_initial(made)
    trials = made.ask(3)
    assert len(trials) == 3
    assert made.centre_row() == made.trials.safety[:12, 0].argmax()
    unsafe = trials.predicted_safe_probability < 0.5
    assert (trials.marked_unsafe == unsafe).all() or not trials.marked_unsafe.any()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("policy", ["mark", "abstain"])
def test_empty_safe_set(method, policy: str) -> None:
    """Every point was seen to be unsafe but one, and the bound asks for more than that one offers."""
    made = method(bowl_problem(), beta=-60.0, empty_safe_set=policy)
    x = np.random.default_rng(0).random((20, 4))
    safety = np.full(20, -1.0)
    safety[3] = 1e-9
    made.observe(x, x[:, 0], safety, initial=True)
    if policy == "abstain":
        with pytest.raises(NoSafePointError, match="believed safe"):
            made.ask(4)
        assert len(made.trials) == 20
    else:
        trials = made.ask(4)
        assert len(trials) == 4
        assert trials.marked_unsafe.all()


@pytest.mark.parametrize("method", METHODS)
def test_batch_larger_than_the_safe_candidates(method) -> None:
    made = method(rows_problem(30), empty_safe_set="mark")
    observe_initial(made, 10)
    trials = made.ask(20)
    assert len(np.unique(trials.candidate)) == 20
    made = method(rows_problem(30), beta=-2.0, empty_safe_set="abstain")
    observe_initial(made, 10)
    trials = made.ask(20)
    assert 1 <= len(trials) <= 20
    assert not trials.marked_unsafe.any()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("x", "objective", "safety"),
    [
        (np.random.default_rng(0).random((30, 4)), np.ones(30), np.ones(30)),  # constant outcomes
        (np.full((30, 4), 0.4), np.arange(30.0), np.ones(30)),  # thirty equal points
        (np.full((1, 4), 0.4), np.zeros(1), np.ones(1)),  # one point
        (np.random.default_rng(0).random((30, 4)), np.append(np.zeros(29), 1e12), np.ones(30)),
        (np.random.default_rng(0).random((30, 4)), np.zeros(30), np.append(np.ones(29), -1e12)),
        (np.random.default_rng(0).random((30, 4)) * 1e-9, np.arange(30.0), np.ones(30)),
        (np.vstack([np.full((5, 4), 0.5), np.ones((1, 4))]), np.arange(6.0), np.ones(6)),
    ],
)
@pytest.mark.thorough
def test_ill_natured_data(method, x, objective, safety) -> None:
    made = method(bowl_problem(), empty_safe_set="mark")
    made.observe(x, objective, safety, initial=True)
    for _ in range(3):
        trials = made.ask(3)
        assert np.isfinite(trials.x).all()
        assert ((trials.x >= 0) & (trials.x <= 1)).all()
        assert np.isfinite(trials.predicted_safe_probability).all()
        made.tell(trials, *bowl(trials.x))
    assert made.trials.completed.all()


@pytest.mark.parametrize(
    "values",
    [
        [10**400, 0.0],
        np.array([1j, 0.0]),
        np.array(["2020-01-01", "2020-01-02"], "M8[D]"),
        np.ma.masked_array([1.0, 2.0], [True, False]),
        ["1.5", "2"],
        [b"1", b"2"],
        np.array(["1_000", 2.0], object),
        [None, "1_000"],
        np.zeros(2, [("a", float)]),
        [[0.0, 1.0], [2.0]],
    ],
    ids=[
        *("huge", "complex", "dates", "masked", "text", "bytes", "text among objects", "text beside nothing"),
        *("records", "ragged"),
    ],
)
@pytest.mark.parametrize("where", ["objective", "safety", "x", "status", "candidate"])
def test_what_is_no_number_is_not_made_one(values, where: str) -> None:
    made = HdSafeBO(bowl_problem())
    given = {"x": np.zeros((2, 4)), "objective": [0.0, 0.0], "safety": [0.0, 0.0]} | {where: values}
    with pytest.raises(TrialError, match=where):
        made.observe(**given)
    assert len(made.trials) == 0


def test_ids_of_different_lengths() -> None:
    with pytest.raises(TrialError, match="list of their ids"):
        HdSafeBO(bowl_problem()).tell([[0, 1], [2]], [0.0], [0.0])
