"""Which trials are repeated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdsafebo.gp.fit import fit_gaussian_process
from hdsafebo.gp.kernel import exact_distances
from hdsafebo.session.advice.repetition import top_two
from hdsafebo.session.session import Session
from hdsafebo.session.spaces.space import Report
from hdsafebo.session.views.audit import replay
from tests.session.small import bowl

REPEATING = {
    "name": "hdsafebo_shortlist",
    "settings": {"every": 3, "shortlist": 40, "elsewhere": 20, "alpha": 0.99, "first": 4, "repeat": 1.0},
}


def test_those_that_may_be_best_are_measured_again() -> None:
    """Two that are close to each other and best, half of the time each; never those that are far worse."""
    rng = np.random.default_rng(0)
    x = np.linspace(0.0, 1.0, 12)[:, None]
    y = np.where(np.arange(12) < 10, -1.0, 1.0) + 0.01 * rng.standard_normal(12)
    gp = fit_gaussian_process(x, exact_distances(x, x), y)
    chosen = [top_two(gp, x, rng) for _ in range(200)]
    counts = np.bincount(chosen, minlength=12)
    assert counts[:10].sum() == 0
    assert counts[10:].min() > 60


def test_one_alternative_is_the_best() -> None:
    x = np.array([[0.0], [1.0]])
    gp = fit_gaussian_process(x, exact_distances(x, x), np.array([0.0, 1.0]))
    assert top_two(gp, x[:1], np.random.default_rng(0)) == 0


def test_safe_trials_that_are_permitted_are_repeated(make_session: Callable[..., Session]) -> None:
    session = make_session("list", method=REPEATING)
    seen = [tuple(t.point["values"]) for t in session.state.trials]
    for number in range(12):
        suggestion = session.suggest("ann")
        values = tuple(suggestion.point["values"])
        assert (values in seen) == (number >= 4)
        assert bowl(values)["margin"] >= 0 or values not in seen
        if number == 6:
            session.refuse("ann", "not again", suggestion.number)
            refused = values
            continue
        assert number < 6 or values != refused
        session.approve("ann", suggestion.number)
        session.record("ann", Report(values=bowl(values)))
        seen.append(values)
    assert replay(session) == []


def test_what_was_unsafe_once_is_not_repeated(make_session: Callable[..., Session]) -> None:
    session = make_session("list", method=REPEATING)
    for number in range(10):
        suggestion = session.suggest("ann")
        values = tuple(suggestion.point["values"])
        if number == 5:
            unsafe = values
        assert number <= 5 or values != unsafe
        session.approve("ann", suggestion.number)
        margin = {"margin": -0.01} if number == 5 else {}
        session.record("ann", Report(values=bowl(values) | margin))
