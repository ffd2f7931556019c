"""Whatever is told: taken in whole and finite, or refused whole; what was told before stays."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hdsafebo.errors import TrialError
from hdsafebo.optimizers.controls.sobol import Sobol
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.trials import Status, Trials

NUMBERS = st.one_of(
    st.floats(),
    st.floats(-1, 1),
    st.sampled_from([0.0, -0.0, 1e308, -1e308, 5e-324, 1, True, None, "a", "", b"x", [], {}, object()]),
)
DTYPES = st.sampled_from(
    [None, np.float64, np.float32, np.float16, np.int64, np.int8, np.uint64, bool, object]
)


@st.composite
def arrays(draw: st.DrawFn) -> Any:
    """Numbers in many shapes and types, as lists or arrays; most often one per trial."""
    values: Any = draw(st.lists(NUMBERS, max_size=4) | st.lists(st.floats(-1, 1), min_size=1, max_size=3))
    depth = draw(st.sampled_from([0, 0, 0, 1, 2]))
    for _ in range(depth):
        values = [[v] for v in values] if draw(st.booleans()) else [values]
    dtype = draw(DTYPES)
    if draw(st.booleans()) and all(isinstance(v, float) and abs(v) < 100 for v in values):
        return np.array(values, dtype)
    return values


SAFETY = arrays() | st.builds(
    lambda n, m, v: np.full((n, m), v), st.integers(0, 3), st.integers(0, 3), st.floats()
)
STATES = st.one_of(
    st.none(),
    st.sampled_from([1, 2]),
    st.integers(-1, 300),
    st.lists(st.integers(-1, 4), max_size=3),
    st.lists(st.sampled_from([1, 2]), min_size=1, max_size=3),
    st.sampled_from(["completed", 1.5, np.nan, ["a"], b"1"]),
)
IDS = st.sampled_from([[0.0], ["a"], [[0]], [], [None], [2**70], "ab", [True], [12], [-2, 0]])
POINTS = st.one_of(
    st.lists(st.lists(st.floats(0, 1), min_size=2, max_size=2), max_size=3),
    arrays(),
    st.builds(lambda n, d, v: np.full((n, d), v), st.integers(0, 3), st.integers(0, 3), st.floats()),
)
ROWS = st.none() | st.lists(st.integers(-2, 1), max_size=3) | st.sampled_from([[0.5], ["a"], -1, [[-1]]])
MOSTLY_FINITE = st.integers(0, 15).flatmap(
    lambda k: st.floats(-1, 1) if k else st.sampled_from([np.nan, np.inf, -np.inf])
)
SHAPED = st.tuples(  # of the right shape for up to four trials, whatever the values
    st.lists(MOSTLY_FINITE, min_size=4, max_size=4),
    st.lists(st.lists(MOSTLY_FINITE, min_size=2, max_size=2), min_size=4, max_size=4),
    st.none() | st.lists(st.sampled_from([1, 1, 1, 2]), min_size=4, max_size=4),
)
ACTIONS = st.one_of(
    st.tuples(
        st.just("ask"), st.integers(1, 3) | st.sampled_from([-1, 0, None, 1.0, True, "2", np.int64(2)])
    ),
    st.tuples(st.just("tell"), IDS, st.tuples(arrays(), SAFETY, STATES)),
    st.tuples(st.just("tell last"), st.none(), st.tuples(arrays(), SAFETY, STATES)),
    st.tuples(st.just("observe"), POINTS, st.tuples(arrays(), SAFETY, STATES), ROWS),
    st.tuples(st.just("tell"), st.lists(st.integers(-1, 4), min_size=1, max_size=3), SHAPED),
    st.tuples(st.just("tell last"), st.none(), SHAPED),
    st.tuples(st.just("observe"), st.integers(1, 3).map(lambda n: np.full((n, 2), 0.3)), SHAPED, st.none()),
)


def act(made: Sobol, last: Trials, action: tuple[Any, ...]) -> Trials:
    """One call of the interface; returns the trials that were asked last."""
    kind, what = action[:2]
    if kind == "ask":
        return made.ask(what)
    trials = last if kind == "tell last" else what
    objective, safety, status = (fitted(values, trials) for values in action[2])
    if kind == "observe":
        made.observe(trials, objective, safety, status=status, candidate=action[3])
    else:
        made.tell(trials, objective, safety, status=status)
    return last


def fitted(values: Any, trials: Any) -> Any:
    """The first of four values, as many as there are trials; anything else as it is."""
    return values[: len(trials)] if isinstance(values, list) and len(values) == 4 else values


def assert_sound(table: Trials) -> None:
    """Finite where completed, NaN elsewhere, ids in order."""
    np.testing.assert_array_equal(table.id, np.arange(len(table)))
    np.testing.assert_array_equal(np.isfinite(table.objective), table.completed)
    np.testing.assert_array_equal(np.isfinite(table.safety).all(axis=1), table.completed)
    assert np.isfinite(table.x).all()
    assert np.isin(table.status, list(Status)).all()


def assert_kept(before: Trials, after: Trials, *, unchanged: bool) -> None:
    """What was known is known still; after a refusal, nothing else is."""
    assert len(after) == len(before) if unchanged else len(after) >= len(before)
    known = (before.status != Status.PENDING) | unchanged
    for name in ("x", "z", "objective", "safety", "status"):
        np.testing.assert_array_equal(
            getattr(before, name)[known], getattr(after, name)[: len(before)][known]
        )


@settings(
    max_examples=100, derandomize=True, database=None, deadline=None,
    suppress_health_check=list(HealthCheck),
)  # fmt: skip
@given(st.lists(ACTIONS, min_size=1, max_size=8))
def test_a_hundred_ways_to_use_the_interface(actions: list[tuple[Any, ...]]) -> None:
    safety = (Safety("one", 0.0), Safety("two", -0.5))
    problem = FunctionProblem(lambda x: (x.sum(axis=1), x), bounds=[[0.0] * 2, [1.0] * 2], safety=safety)
    made = Sobol(problem, seed=0)
    made.ask(2)
    made.tell([0], [0.5], [[0.1, 0.2]])
    first, last = made.trials, made.ask(3)
    for action in actions:
        before = made.trials
        try:
            last = act(made, last, action)
        except TrialError:
            assert_kept(before, made.trials, unchanged=True)
        else:
            assert_kept(before, made.trials, unchanged=False)
        assert_sound(made.trials)
    assert_kept(first, made.trials, unchanged=False)
