"""Parameters: what they take, what they refuse by name, and where points of the box land."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hdsafebo import Choice, Fixed, Integer, Real
from hdsafebo.system.errors import DescriptionError, TableError

PARTS = [
    Real("r", -2, 7),
    Real("log", 0.01, 50, log=True),
    Real("step", -1, 2, step=0.25),
    Integer("i", -3, 12),
    Integer("even", 0, 10, step=2),
    Integer("ilog", 1, 1000, log=True),
    Choice("c", ["x", "y", "z"]),
    Choice("o", [1, 2, 4], ordered=True),
    Choice("b", [True, False]),
]


@pytest.mark.parametrize("part", PARTS, ids=lambda p: p.name)
@settings(deadline=None)
@given(seed=st.integers(0, 10_000))
def test_landed_points_decode_and_encode_to_themselves(part, seed: int) -> None:
    columns = part.land(np.random.default_rng(seed).random((20, part.width)))
    values = part.decode(columns)
    np.testing.assert_allclose(part.encode(values), columns, atol=1e-12)
    np.testing.assert_array_equal(part.land(columns).round(12), columns.round(12))
    shown = [part.python(v) for v in values]
    np.testing.assert_allclose(part.check(shown, exact=part.spacing is not None), values, atol=1e-9)


def test_log_makes_ratios_distances() -> None:
    u = Real("f", 1, 100, log=True).encode(np.array([1.0, 10.0, 100.0]))
    np.testing.assert_allclose(u[:, 0], [0.0, 0.5, 1.0])


def test_steps_end_within_the_range() -> None:
    part = Real("s", 0, 1, step=0.3)
    assert part.decode(part.land(np.linspace(0, 1, 101)[:, None])).max() == pytest.approx(0.9)
    assert part.beside(0.9) == [pytest.approx(0.6)]
    assert Choice("c", ["x", "y", "z"]).beside(1.0) == [0.0, 2.0]
    assert Choice("o", [1, 2, 4], ordered=True).beside(0.0) == [1.0]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Real("a", 3, 3), "'a' ranges from 3 to 3"),
        (lambda: Real("a", 0, float("nan")), "'a': upper is nan"),
        (lambda: Real("a", 0, "ten"), "'a': upper is 'ten'"),
        (lambda: Real("a", 0, 1, log=True), "'a' has log=True and lower 0"),
        (lambda: Real("a", 0, 1, step=2), "'a': step is 2"),
        (lambda: Real("a,b", 0, 1), "name of a parameter is 'a,b'"),
        (lambda: Integer("n", 0.5, 3), "'n': lower is 0.5; expected a whole number"),
        (lambda: Choice("c", ["x"]), "'c' has 1 values"),
        (lambda: Choice("c", "xyz"), "'c': values are 'xyz'"),
        (lambda: Choice("c", ["x", "x"]), "values of parameter 'c' share the names 'x'"),
        (lambda: Choice("c", ["x", None]), "'c' can be None"),
        (lambda: Fixed("v", [1]), "'v' is fixed at"),
    ],
)
def test_bad_descriptions_are_named(make, message: str) -> None:
    with pytest.raises(DescriptionError, match=message.replace("[", r"\[")):
        make()


@pytest.mark.parametrize(
    ("part", "values", "message"),
    [
        (Real("a", 0, 1, unit="kg"), [0.2, 1.5], "row 1: a is 1.5; expected 0 to 1 kg"),
        (Real("a", 0, 1), [np.nan], "row 0: a is nan"),
        (Real("a", 0, 1), [True], "row 0: a is True; expected a number"),
        (Real("a", 0, 1), ["0.3"], "row 0: a is '0.3'; expected a number"),
        (Choice("c", ["x", "y"]), ["x", "w"], "row 1: c is 'w'; expected one of 'x', 'y'"),
        (Fixed("v", 3), [4], "row 0: v is 4; expected the fixed 3"),
    ],
)
def test_bad_values_are_named(part, values: list, message: str) -> None:
    with pytest.raises(TableError, match=message):
        part.check(values)


def test_what_was_set_between_steps_is_taken_but_no_list_may_hold_it() -> None:
    part = Integer("n", 0, 5)
    assert part.check([2.5]).tolist() == [2.5]
    with pytest.raises(TableError, match=r"n is 2\.5; expected 0 plus a multiple of 1"):
        part.check([2.5], exact=True)


@pytest.mark.parametrize(
    ("part", "values"),
    [
        (Real("a", -30, 30, step=0.5), [0.3, -29.9, 0.5]),
        (Real("a", 0.5, 40, step=0.5, log=True), [0.71, 39.9, 12.5]),
        (Integer("a", 0, 5), [2.5, 0.25, 3]),
        (Integer("a", 0, 100, step=5), [7, 99.5, 15]),
    ],
)
def test_what_was_set_between_steps_is_shown_as_it_was_set(part: Real, values: list[float]) -> None:
    decoded = part.decode(part.encode(part.check(values)))
    assert [part.python(v) for v in decoded] == pytest.approx(values, rel=1e-12)
    assert isinstance(part.python(decoded[-1]), int if isinstance(part, Integer) else float)


def test_choices_of_numbers_survive_a_column_of_floats() -> None:
    assert Choice("n", [1, 2, 4]).check([1.0, np.int64(4), np.float64(2)]).tolist() == [0.0, 2.0, 1.0]


@pytest.mark.parametrize(
    "part",
    [
        Real("a", 0, 1),
        Real("a", 1e6, 1e6 + 1),
        Real("a", 2.4e9, 2.4e9 + 10),
        Real("a", -1e9, -1e9 + 1e3, log=False),
        Real("a", 1e6, 1e6 + 1, step=1e-4),
        Real("a", 1e9, 1e9 + 1, step=4e-4),
        Real("a", 0, 1e6, step=1e-7),
        Real("a", 1e-300, 1e300, log=True),
        Integer("a", 0, 10**13),
        Integer("a", 10**15, 10**15 + 10),
    ],
)
def test_a_shown_value_is_the_one_that_was_judged(part: Real) -> None:
    """Twelve digits are few far from 0: the setting that is run would be another than the believed one."""
    columns = part.land(np.random.default_rng(0).uniform(size=(200, 1)))
    shown = part.check([part.python(v) for v in part.decode(columns)])
    rounding = 4 * np.spacing(max(abs(part.lower), part.upper)) / (part.upper - part.lower)
    assert np.abs(part.encode(shown) - columns).max() <= 1e-9 + rounding
    if part.spacing is not None:
        steps = (shown - part.lower) / part.spacing
        assert (
            np.abs(steps - np.round(steps)).max()
            <= 1e-6 + 4 * np.spacing(max(abs(part.lower), part.upper)) / part.spacing
        )
