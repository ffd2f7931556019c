"""One climb after another: when a climb is over, where the next begins, and what that is worth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.gp.surrogate import fit_surrogate
from hdsafebo.optimizers.local.ascents import AscentSearch
from hdsafebo.optimizers.local.base import gain
from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
from hdsafebo.optimizers.local.restarts import Restarts, jump
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.search.ascent import Metric
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray
from optimizers.toy import Halving, bowl_problem, observe_initial, rows_problem, run_rounds


def two_hills(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A low hill at 0.25 and a high one at 0.75 of both coordinates; all of it is safe."""
    low, high = (np.exp(-((x - c) ** 2).sum(axis=1) / 0.02) for c in (0.25, 0.75))
    return low + 1.5 * high, np.ones((len(x), 1))


def hills_problem() -> FunctionProblem:
    return FunctionProblem(two_hills, [[0.0, 0.0], [1.0, 1.0]], [Safety("always", 0.0)], name="hills")


def table(objective: list[float]) -> Trials:
    values = np.array(objective)
    x = np.linspace(0.0, 1.0, len(values))[:, None]
    return Trials.pending(x, x, 1, objective=values)


@pytest.mark.parametrize(
    ("objective", "among", "fresh", "expected"),
    [
        ([1.0, 2.0], [True, True], [1], (True, True)),
        ([2.0, 2.0], [True, True], [1], (False, False)),
        ([2.0, 2.0005], [True, True], [1], (True, False)),
        ([-2.0, -1.9995], [True, True], [1], (True, False)),
        ([1.0, 2.0], [True, False], [1], (False, False)),
        ([1.0, 0.5], [False, True], [1], (True, True)),
    ],
)
def test_gain(objective, among, fresh, expected) -> None:
    assert gain(table(objective), np.array(among), np.array(fresh)) == expected


def at_points(x: list[float]) -> HdSafeBOLocal:
    """Codes in one dimension whose outcomes have a length scale near one."""
    problem = FunctionProblem(lambda x: (np.sin(x[:, 0]), np.ones((len(x), 1))), [[0.0], [20.0]])
    made = HdSafeBOLocal(problem, embedding=Halving())
    points = np.array(x)[:, None]
    made.observe(points, *problem.function(points), initial=True)
    made.search.since = len(x)
    return made


def test_a_climb_is_over_when_it_stalls_or_arrives() -> None:
    made = at_points([float(v) for v in range(20)])
    climbs = climbs_of(made)
    search, length = climbs.search, made.surrogate.objective.length_scale
    inputs = search.kernel_inputs(made.trials)
    assert climbs._over(inputs) == (True, ())  # nothing of its own to go on from
    search.since, climbs.stalled = 0, 7
    top = made.centre_row()
    assert climbs._over(inputs) == (False, ())
    climbs.stalled = 8
    assert climbs._over(inputs) == (True, (top,))
    climbs.stalled = 0
    distance = np.linalg.norm(inputs - inputs[top], axis=1)
    climbs.tops = (int(np.flatnonzero(distance > 0.25 * length)[0]),)
    assert climbs._over(inputs) == (False, climbs.tops)
    climbs.tops = (top,)
    assert climbs._over(inputs) == (True, (top,))  # where it would end is known


def test_a_jump_is_safe_and_leads_away_from_the_tops() -> None:
    rng = np.random.default_rng(0)
    x = rng.random((40, 2))
    y, _ = two_hills(x)
    surrogate = fit_surrogate(x, y, x[:, :1] - 0.1, np.array([0.0]))
    metric = Metric(np.ones(2), np.zeros(2))
    top = np.array([[0.75, 0.75]])
    for _ in range(5):
        point = jump(surrogate, x, top, metric, -2.0, rng)
        assert point is not None
        assert ((point >= 0) & (point <= 1)).all()
        assert surrogate.believed_safe(point, -2.0).all()
        assert np.linalg.norm(point - top) >= 0.5 * surrogate.objective.length_scale
    everywhere = np.stack(np.meshgrid(*[np.linspace(0, 1, 40)] * 2), axis=-1).reshape(-1, 2)
    assert jump(surrogate, x, everywhere, metric, -2.0, rng) is None


def climbs_of(made: HdSafeBOLocal) -> Restarts:
    assert isinstance(made.search, AscentSearch)
    assert made._restarts is not None
    return made._restarts


def climb_hills(seed: int, rounds: int) -> HdSafeBOLocal:
    problem = hills_problem()
    made = HdSafeBOLocal(problem, seed=seed, embedding=Halving(), bounds=[[0.0, 0.0], [0.5, 0.5]])
    x = 0.25 + 0.15 * np.random.default_rng(seed).standard_normal((8, 2))  # around the low hill
    x = np.clip(x, 0.0, 1.0)
    made.observe(x, *problem.function(x), initial=True)
    run_rounds(made, rounds, 1)
    return made


def bowl_climber(**settings: object) -> HdSafeBOLocal:
    made = HdSafeBOLocal(
        bowl_problem(), embedding=Halving(), bounds=[[0.0] * 4, [0.5] * 4], seed=3, **settings
    )
    observe_initial(made, 8)
    return made


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Climbs are over after two rounds without gain."""
    monkeypatch.setattr("hdsafebo.optimizers.local.restarts.PATIENCE", 2)


@pytest.mark.thorough
def test_single_trials_climb_the_other_hill_too(monkeypatch: pytest.MonkeyPatch) -> None:
    several = climb_hills(3, 45)
    assert several.trials.objective.max() == pytest.approx(1.5, abs=0.01)
    assert climbs_of(several).tops
    assert not several.trials.marked_unsafe.any()
    monkeypatch.setattr("hdsafebo.optimizers.local.restarts.PATIENCE", 1000)
    once = climb_hills(3, 20)
    assert once.trials.objective.max() == pytest.approx(1.0, abs=0.01)
    assert (climbs_of(once).search.since, climbs_of(once).tops) == (0, ())


@pytest.mark.usefixtures("impatient")
def test_batches_go_on_as_ever() -> None:
    made = bowl_climber()
    run_rounds(made, 6, 3)
    assert (climbs_of(made).search.since, climbs_of(made).tops) == (0, ())


@pytest.mark.usefixtures("impatient")
def test_first_trials_that_beta_would_refuse_are_marked() -> None:
    made = bowl_climber(restarts={"beta": 4.0})
    run_rounds(made, 25, 1)
    assert climbs_of(made).tops
    believed = made.trials[~made.trials.initial & ~made.trials.marked_unsafe]
    assert made.trials.marked_unsafe.any()
    assert (believed.predicted_safe_probability >= 0.97).all()


@pytest.mark.usefixtures("impatient")
def test_a_climb_survives_a_file(tmp_path: Path) -> None:
    made = bowl_climber()
    run_rounds(made, 12, 1)
    assert climbs_of(made).tops
    made.save(tmp_path / "state")
    again = HdSafeBOLocal.load(tmp_path / "state", bowl_problem(), Halving())
    assert climbs_of(again).state() == climbs_of(made).state()
    run_rounds(made, 4, 1)
    run_rounds(again, 4, 1)
    np.testing.assert_array_equal(again.trials.z, made.trials.z)


@pytest.mark.usefixtures("impatient")
@pytest.mark.thorough
def test_an_ask_that_fails_begins_no_climb(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(trials: Trials):
        raise MemoryError("no memory")

    made = bowl_climber(restarts={"beta": 4.0})
    begun = set()
    for _ in range(20):
        before = made.method_state()
        with monkeypatch.context() as patch:
            patch.setattr(made, "believe", fail)
            with pytest.raises(MemoryError):
                made.ask(1)
        assert made.method_state() == before
        trials = made.ask(1)
        begun.add(climbs_of(made).search.since)
        made.tell(trials, *made.problem.function(trials.x))
    assert len(begun) > 1


def test_restarts_are_refused_where_no_search_has_them() -> None:
    with pytest.raises(ParamsError, match=r"'restarts' is of .*; 'bowl' .* a finite candidate set"):
        HdSafeBOLocal(rows_problem(), restarts={"beta": 0.0})
    with pytest.raises(ParamsError, match=r"'restarts' is of .*; 'bowl' is searched without"):
        HdSafeBOLocal(bowl_problem(), restarts={"beta": 0.0})
    with pytest.raises(ParamsError, match=r"unknown setting 'restarts.jump'; valid settings: beta$"):
        HdSafeBOLocal(bowl_problem(), restarts={"jump": 0.0})
