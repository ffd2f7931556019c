"""Effects of days are told apart from the inputs', and the luckiest measurement is not taken for the best."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdsafebo.session.believed import believed_best
from hdsafebo.session.days import fit_days
from hdsafebo.session.informed import informed_optimiser
from hdsafebo.session.session import Session
from hdsafebo.session.shortlist import HdSafeBOShortlist
from hdsafebo.session.space import Report
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


def test_one_point_and_constant_outcomes() -> None:
    model = fit_days(np.zeros((1, 2)), np.array([[3.0]]), np.zeros(1, int))
    assert model.value[0, 0] == 3.0
    assert model.effect[0, 0] == 0.0
    constant = fit_days(np.zeros((4, 1)), np.full((4, 1), 2.0), np.array([0, 0, 1, 1]))
    np.testing.assert_allclose(constant.value, 2.0)


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


def test_the_optimisers_model_is_without_the_days_effect(make_session: Callable[..., Session]) -> None:
    session = _with_days(make_session, shift=0.5)
    optimiser = informed_optimiser(session.definition, session.search(), "speed", 1, session.state.trials)
    assert isinstance(optimiser, HdSafeBOShortlist)
    later = np.array([t.day == 2 for t in session.state.trials])
    np.testing.assert_array_equal(optimiser.days == 2, later)
    optimiser._choose_theta()
    fitted = optimiser.surrogate.objective
    told = fitted.outcomes.restore(fitted.values)
    effect = optimiser.trials.objective - told
    assert np.ptp(effect[later]) < 1e-12
    assert effect[later][0] - effect[~later][0] > 0.2


def test_the_luckiest_is_not_the_best(make_session: Callable[..., Session]) -> None:
    session = _with_days(make_session, shift=0.0)
    highest = session.best("speed")
    assert highest is not None
    assert highest.point["values"][1] == 0.5  # the one that was measured too high
    trial, mean = believed_best(session)["speed"]
    values = [t.point["values"] for t in session.state.trials]
    assert bowl(trial.point["values"])["speed"] >= sorted(bowl(v)["speed"] for v in values)[-8]
    assert mean < (highest.outcomes or {})["speed"]
    assert believed_best(session, initial=True)["speed"][0].origin == "initial"
