"""Contexts, points that cannot be run, what was really run: the same for every method that can."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo import FunctionProblem, HdSafeBOLocal, Safety, make_optimizer
from hdsafebo.errors import ProblemError, TrialError
from hdsafebo.optimizers.base import Optimizer
from hdsafebo.trials import Status
from hdsafebo.typing import FloatArray
from optimizers.toy import Halving, Rows

HOLDING = ["hdsafebo", "hdsafebo_local", "linebo"]


def function(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The best of the first two columns follows the third, which is a context."""
    return -((x[:, :2] - 0.3 - 0.4 * x[:, 2:]) ** 2).sum(axis=1), 1.2 - x.sum(axis=1)


def contextual(lands: bool = False) -> FunctionProblem:
    problem = FunctionProblem(function, [[0.0] * 3, [1.0] * 3], [Safety("room", 0.0)], name="contextual")
    problem.contexts = (2,)
    if lands:
        problem.lands = True
        problem.land = lambda x: np.column_stack([np.round(x[:, :2] * 8) / 8, x[:, 2]])  # type: ignore[method-assign]
    return problem


def make(name: str, problem: FunctionProblem, **settings) -> Optimizer:
    optimizer = make_optimizer(name, problem, seed=0, alpha=0.9, **settings)
    x = problem.land(np.random.default_rng(0).random((15, 3)) * [0.4, 0.4, 0.5])
    optimizer.observe(x, *problem.function(x), initial=True)
    return optimizer


@pytest.mark.parametrize("name", HOLDING)
@pytest.mark.parametrize("lands", [False, True])
def test_trials_have_the_context_and_lie_where_they_can_be_run(name: str, lands: bool) -> None:
    problem = contextual(lands)
    optimizer = make(name, problem)
    for context in (0.2, 0.45, 0.1):
        trials = optimizer.ask(3, context=[context])
        assert (trials.x[:, 2] == context).all()
        np.testing.assert_array_equal(problem.land(trials.x), trials.x)
        believed, _ = optimizer.believe(trials)
        np.testing.assert_array_equal(trials.predicted_safe_probability, believed)
        optimizer.tell(trials, *problem.function(trials.x))
    assert optimizer.feasible.mean() > 0.85


@pytest.mark.parametrize("name", HOLDING)
def test_resumes_to_the_bit(name: str, tmp_path) -> None:
    optimizer = make(name, contextual(lands=True))
    optimizer.tell(first := optimizer.ask(2, context=[0.3]), *function(first.x))
    optimizer.save(tmp_path / "state")
    resumed = type(optimizer).load(tmp_path / "state", contextual(lands=True))
    np.testing.assert_array_equal(optimizer.ask(3, context=[0.35]).x, resumed.ask(3, context=[0.35]).x)


def test_the_centre_follows_the_context() -> None:
    problem = contextual()
    problem.safety = (Safety("room", -5.0),)  # both are safe under both contexts
    optimizer = make("hdsafebo_local", problem)
    x = np.array([[0.3, 0.3, 0.1], [0.5, 0.5, 0.1], [0.3, 0.3, 0.6], [0.5, 0.5, 0.6]])
    optimizer.observe(x, *function(x))
    rows = {}
    for context in (0.0, 0.5):
        optimizer.ask(1, context=[context])
        rows[context] = optimizer.trials.x[optimizer.centre_row(), :2].mean()
    assert rows[0.0] < 0.4 < rows[0.5]


@pytest.mark.parametrize(
    ("context", "message"),
    [
        (None, "has 1 context columns; pass their values"),
        ([0.1, 0.2], r"context has shape \(1, 2\); expected \(n, 1\)"),
        ([1.5], r"context is \[1.5\]; expected \[0.0\] to \[1.0\]"),
        ([np.nan], "context holds NaN"),
    ],
)
def test_bad_contexts_are_named(context, message: str) -> None:
    optimizer = make("linebo", contextual())
    state = optimizer.rng.bit_generator.state
    with pytest.raises(TrialError, match=message):
        optimizer.ask(1, context=context)
    assert optimizer.rng.bit_generator.state == state


def test_what_cannot_hold_contexts_says_so() -> None:
    with pytest.raises(
        ProblemError, match=r"'scbo' would choose the contexts of 'contextual'.*hdsafebo_local"
    ):
        make_optimizer("scbo", contextual())
    with pytest.raises(ProblemError, match="cannot be searched through an embedding"):
        HdSafeBOLocal(contextual(), embedding=Halving())
    rows = contextual()
    rows.candidates = Rows(np.random.default_rng(0).random((20, 3)))
    with pytest.raises(ProblemError, match="cannot hold its contexts; expected a ContextualSet"):
        HdSafeBOLocal(rows)


def test_what_was_really_run_replaces_what_was_asked() -> None:
    problem = FunctionProblem(
        lambda x: (x.sum(1), 1 - x), [[0.0, 0.0], [1.0, 1.0]], [Safety("a", 0.0), Safety("b", 0.0)]
    )
    optimizer = HdSafeBOLocal(problem, seed=0)
    x = np.random.default_rng(0).random((10, 2)) * 0.5
    optimizer.observe(x, *problem.function(x))
    trials = optimizer.ask(2)
    ran = trials.x.copy()
    ran[1] = [0.9, 0.1]
    surrogate = optimizer.surrogate
    optimizer.tell(trials, *problem.function(ran), x=ran)
    known = optimizer.trials[trials.id]
    np.testing.assert_array_equal(known.x, ran)
    np.testing.assert_array_equal(known.z, ran)
    assert known.predicted_safe_probability[0] == trials.predicted_safe_probability[0]
    inputs = optimizer.space.kernel_inputs(ran[1:])
    assert known.predicted_safe_probability[1] == surrogate.safe_probability(inputs)[0]
    optimizer.tell(trials.id, *problem.function(ran), x=ran)  # the same once more
    with pytest.raises(TrialError, match="told before with another x"):
        optimizer.tell(trials.id, *problem.function(ran), x=ran * 0.5)
    with pytest.raises(TrialError, match=r"x is 1\.7 in row 0, column 1; expected 0 to 1"):
        optimizer.tell(optimizer.ask(1), [0.0], [[0.0, 0.0]], x=[[0.5, 1.7]])


def test_points_outside_the_bounds_are_refused() -> None:
    problem = contextual()
    optimizer = HdSafeBOLocal(problem)
    with pytest.raises(
        TrialError, match=r"x is -0\.1 in row 1, column 2; expected 0 to 1, the bounds of 'contextual'"
    ):
        optimizer.observe([[0.1, 0.1, 0.1], [0.1, 0.1, -0.1]], [0, 0], [0, 0])
    assert len(optimizer.trials) == 0
    optimizer.observe([[0.1, 0.1, 1.0 + 1e-12]], [0.0], [0.0])  # rounding


@pytest.mark.parametrize("noise", [[[0.1]], [[0.1, -1.0]], [[0.1, np.inf]]])
def test_bad_noise_is_refused(noise) -> None:
    optimizer = HdSafeBOLocal(contextual())
    with pytest.raises(TrialError, match="noise"):
        optimizer.observe([[0.1, 0.1, 0.1]], [0.0], [0.0], noise=noise)
    assert len(optimizer.trials) == 0


def test_bad_noise_of_a_problem_is_refused() -> None:
    problem = contextual()
    problem.noise = np.array([0.1])
    with pytest.raises(ProblemError, match="expected 2 positive standard deviations"):
        HdSafeBOLocal(problem)
    with_transform = FunctionProblem(function, [[0.1] * 3, [1.0] * 3], [Safety("s", 1.0, transform=np.log)])
    with_transform.noise = np.array([np.nan, 0.1])
    with pytest.raises(ProblemError, match="has a transform, and a known noise"):
        HdSafeBOLocal(with_transform)


def test_failures_teach_where_the_problem_says_so() -> None:
    chances = {}
    for teach in (False, True):
        problem = contextual()
        problem.contexts, problem.failures_teach = (), teach
        optimizer = make("hdsafebo_local", problem)
        trials = optimizer.ask(3)
        optimizer.tell(trials, np.zeros(3), np.zeros(3), status=Status.FAILED)
        chances[teach], _ = optimizer.believe(trials)
    assert (chances[True] < 0.5).all()
    assert (chances[False] > 0.8).all()


def test_bounds_given_as_pairs_are_refused() -> None:
    with pytest.raises(
        ProblemError, match=r"a pair of limits per dimension; expected .*\[\[0.0, 0.0\], \[1.0, 5.0\]\]"
    ):
        FunctionProblem(function, [[0, 1], [0, 5]])
    with pytest.raises(ProblemError, match="all lower limits, then all upper ones"):
        FunctionProblem(function, [[0, 1], [0, 5], [0, 1]])
