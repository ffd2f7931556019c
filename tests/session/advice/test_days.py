"""Effects of days are told apart from the inputs', and the luckiest measurement is not taken for the best."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from hdsafebo.gp.kernel import exact_distances, matern52
from hdsafebo.session.advice.days import day_deviation, fit_days
from hdsafebo.session.advice.informed import informed_optimizer
from hdsafebo.session.advice.shortlist import HdSafeBOShortlist
from hdsafebo.session.session import Session
from hdsafebo.session.spaces.space import Report
from hdsafebo.session.views.believed import believed_best
from tests.session.small import bowl


def smooth(x: np.ndarray) -> np.ndarray:
    return np.sin(3.0 * x[:, 0]) + x[:, 1] ** 2


def test_day_effects_are_found() -> None:
    rng = np.random.default_rng(0)
    x, days = rng.random((120, 2)), np.repeat([0, 1, 2], 40)
    true = np.array([0.0, 0.4, -0.3])[days]
    y = np.column_stack([smooth(x) + true, smooth(x)]) + 0.03 * rng.standard_normal((120, 2))
    model = fit_days(x, y, days)
    found = [model.effect[days == d, 0].mean() for d in range(3)]
    np.testing.assert_allclose(np.diff(found), [0.4, -0.7], atol=0.05)
    assert np.abs(model.effect[:, 1]).max() < 0.05  # the second outcome has none
    for column in range(2):  # values are those without the day, up to a constant
        error = model.value[:, column] - smooth(x)
        assert error.std() < 0.05


@pytest.mark.parametrize("size", [1e-300, 1e200, 1e305])
def test_outcomes_of_any_size_are_fitted_alike(size: float) -> None:
    """A mistyped outcome, such as 1e308, must not make an infinity of what is believed of all others."""
    rng = np.random.default_rng(3)
    inputs, days = rng.uniform(size=(12, 2)), np.arange(12) // 4
    outcomes = rng.normal(size=(12, 1)) + inputs[:, :1]
    plain, scaled = fit_days(inputs, outcomes, days), fit_days(inputs, outcomes * size, days)
    np.testing.assert_allclose(scaled.value, plain.value * size, rtol=1e-6)
    np.testing.assert_allclose(scaled.signal, plain.signal * size, rtol=1e-6)


def test_one_point_and_constant_outcomes() -> None:
    model = fit_days(np.zeros((1, 2)), np.array([[3.0]]), np.zeros(1, int))
    assert model.value[0, 0] == 3.0
    assert model.effect[0, 0] == 0.0
    constant = fit_days(np.zeros((4, 1)), np.full((4, 1), 2.0), np.array([0, 0, 1, 1]))
    np.testing.assert_allclose(constant.value, 2.0)


def test_deviation_is_that_of_the_joint_normal() -> None:
    """Against the closed form with the mean as one more coefficient of a very wide prior."""
    rng = np.random.default_rng(1)
    x, days = rng.random((12, 2)), np.repeat([0, 1], 6)
    y = smooth(x)[:, None] + 0.1 * rng.standard_normal((12, 1))
    theta = (1.0, 0.1, 0.03)
    model = fit_days(x, y, days, (theta,))
    distances = exact_distances(x, x)
    prior = matern52(distances, float(np.median(distances))) + 1e6
    covariance = prior + 0.03 * (days[:, None] == days) + 0.1 * np.eye(12)
    posterior = prior - prior @ np.linalg.solve(covariance, prior)
    for row in (0, 7):
        expected = model.signal[0] * np.sqrt(posterior[row, row])
        assert day_deviation(x, days, row, theta, model.signal[0]) == pytest.approx(expected, rel=1e-3)


def test_a_repetition_lowers_the_deviation() -> None:
    x, days = np.array([[0.0], [1.0], [2.0]]), np.zeros(3, int)
    once = day_deviation(x, days, 1, (1.0, 0.1, 0.0), 1.0)
    twice = day_deviation(np.vstack([x, x[1]]), np.zeros(4, int), 1, (1.0, 0.1, 0.0), 1.0)
    assert twice < 0.85 * once


def _with_days(make_session: Callable[..., Session], shift: float) -> Session:
    """Repeats of two points on a second day whose outcomes are shifted, and a lucky one."""
    session = make_session("list", method={"name": "hdsafebo_shortlist"})
    session.stop("ann", "end of the day")
    session.resume("ann")
    session.stop("ann", "again")
    session.resume("ann")
    for number in range(12):
        point = {"values": [0.5, [0.4, 0.5, 0.6][number % 3], 0.0]}
        trial = session.manual("ann", point)
        lucky = 0.2 * (number == 1)
        session.record(
            "ann",
            Report(values=bowl(point["values"]) | {"speed": bowl(point["values"])["speed"] + shift + lucky}),
        )
        assert trial.day == 2
    return session


def test_the_optimizers_model_is_without_the_days_effect(make_session: Callable[..., Session]) -> None:
    session = _with_days(make_session, shift=0.5)
    optimizer = informed_optimizer(session.definition, session.search(), "speed", 1, session.state.trials)
    assert isinstance(optimizer, HdSafeBOShortlist)
    later = np.array([t.day == 2 for t in session.state.trials])
    np.testing.assert_array_equal(optimizer.search.days == 2, later)
    optimizer.search._choose_theta()
    fitted = optimizer.surrogate.objective
    told = fitted.outcomes.restore(fitted.values)
    effect = optimizer.trials.objective - told
    assert np.ptp(effect[later]) < 1e-12
    assert effect[later][0] - effect[~later][0] > 0.2


def test_the_luckiest_is_not_the_best(make_session: Callable[..., Session]) -> None:
    session = _with_days(make_session, shift=0.0)
    highest = session.best("speed")
    assert highest is not None
    assert highest.point["values"][1] == 0.5  # the one that was measured too high
    best = believed_best(session)["speed"]
    values = [t.point["values"] for t in session.state.trials]
    assert bowl(best.trial.point["values"])["speed"] >= sorted(bowl(v)["speed"] for v in values)[-8]
    assert best.mean < (highest.outcomes or {})["speed"]
    assert believed_best(session, ["speed"], initial=True)["speed"].trial.origin == "initial"
