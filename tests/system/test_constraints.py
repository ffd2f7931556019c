"""Linear constraints are met exactly by everything that is landed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hdsafebo import Integer, Linear, Real
from hdsafebo.system.constraints import Feasible
from hdsafebo.system.errors import DescriptionError

PARAMETERS = [Real("a", 0, 10), Real("f", 0.1, 100, log=True), Integer("n", 0, 9), Real("s", 0, 4, step=0.5)]


@pytest.mark.parametrize(
    ("text", "coefficients", "limits"),
    [
        ("2*a + b <= 4", {"a": 2, "b": 1}, (4, None, None)),
        ("a <= b", {"a": 1, "b": -1}, (0, None, None)),
        ("a - 3 >= -(b)/2 + 1", {"a": 1, "b": 0.5}, (None, 4, None)),
        ("1.5 == a + a", {"a": -2}, (None, None, -1.5)),
    ],
)
def test_texts(text: str, coefficients: dict, limits: tuple) -> None:
    parsed = Linear.parse(text)
    assert parsed.coefficients == coefficients
    assert (parsed.at_most, parsed.at_least, parsed.equals) == limits


@pytest.mark.parametrize(
    "text",
    ["a*b <= 1", "a", "a <", "a < b < c", "f(a) <= 1", "a**2 <= 4", "a != 1", "'a' <= 1", "a or b", ""],
)
def test_texts_that_are_no_linear_comparison(text: str) -> None:
    with pytest.raises(DescriptionError, match=r"is not understood.*; expected a form"):
        Linear.parse(text)


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 100_000))
def test_every_landed_point_meets_every_constraint(seed: int) -> None:
    """Random constraints that leave room: all of them hold at one setting."""
    rng = np.random.default_rng(seed)
    inside = {
        "a": float(rng.uniform(1, 9)),
        "f": float(rng.uniform(1, 60)),
        "n": int(rng.integers(0, 10)),
        "s": 1.5,
    }
    constraints = []
    for _ in range(int(rng.integers(1, 4))):
        names = rng.choice(list(inside), int(rng.integers(1, 5)), replace=False)
        weights = {str(n): float(rng.normal()) for n in names}
        left = sum(w * inside[n] for n, w in weights.items())
        room = float(rng.exponential(2.0)) + 0.01
        constraints.append(
            Linear(weights, at_most=left + room)
            if rng.random() < 0.5
            else Linear(weights, at_least=left - room)
        )
    feasible = Feasible(constraints, PARAMETERS)
    raw = rng.uniform(feasible.lower, feasible.upper, (200, 4))
    landed = feasible.land(raw)
    assert feasible.met(landed).all()
    assert (landed >= feasible.lower).all()
    assert (landed <= feasible.upper).all()
    assert (landed[:, 2] == landed[:, 2].round()).all()
    np.testing.assert_allclose(landed[:, 3] * 2, (landed[:, 3] * 2).round(), atol=1e-9)
    kept = feasible.met(feasible._rounded(raw))
    moved = np.abs(landed - feasible._rounded(raw)).max(axis=1) > 1e-9
    assert not (moved & kept & feasible.met(raw)).any(), "what meets all constraints stays where it is"


def test_a_projection_is_the_nearest_point() -> None:
    feasible = Feasible([Linear({"a": 1, "b": 1}, at_most=10)], [Real("a", 0, 10), Real("b", 0, 10)])
    np.testing.assert_allclose(feasible.land(np.array([[8.0, 6.0], [1.0, 2.0]])), [[6, 4], [1, 2]], atol=1e-6)


def test_equalities() -> None:
    parts = [Real(n, 0, 1) for n in "abc"]
    feasible = Feasible([Linear(dict.fromkeys("abc", 1.0), equals=1.0)], parts)
    landed = feasible.land(np.random.default_rng(0).random((300, 3)))
    assert feasible.met(landed).all()
    np.testing.assert_allclose(landed.sum(axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize(
    ("constraint", "message"),
    [
        (Linear({"q": 1}, at_most=1), "'q' is no real or integer parameter; these are a, f, n, s"),
        (Linear({"a": 1}, at_least=11), "no setting meets all of the constraints a >= 11"),
        (Linear({"n": 1}, equals=3), "an equality cannot have parameters with steps"),
    ],
)
def test_bad_constraints_are_named(constraint: Linear, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        Feasible([constraint], PARAMETERS)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Linear({}, at_most=1), "coefficients {}"),
        (lambda: Linear({"a": 0}, at_most=1), "coefficient of 'a' is 0"),
        (lambda: Linear({"a": 1}), "no limit"),
        (lambda: Linear({"a": 1}, at_most=1, equals=1), "at_most and equals"),
        (lambda: Linear({"a": float("inf")}, at_most=1), "coefficient of 'a' is inf"),
    ],
)
def test_half_said_constraints_are_named(make, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        make()
