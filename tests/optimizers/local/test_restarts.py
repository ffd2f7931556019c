"""One climb after another: when a climb is over, where the next begins, and what that is worth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hdsafebo.gp.surrogate import fit_surrogate
from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
from hdsafebo.optimizers.local.restarts import Climb, gain, jump
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.search.metric import Metric
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray
from optimizers.toy import Halving, bowl_problem, observe_initial, run_rounds


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


def test_a_climb_is_over_when_it_stalls_or_arrives() -> None:
    inputs = np.array([[0.0], [0.1], [3.0]])
    climb = Climb().after(True).after(False).after(False)
    assert climb.stalled == 2
    assert climb.over(2, inputs, 1.0, patience=3) is None
    assert climb.over(2, inputs, 1.0, patience=2) == Climb(tops=(2,))
    again = Climb(first=5, tops=(0,))
    assert again.over(1, inputs, 1.0, patience=9) == Climb(tops=(0,))  # where it would end is known
    assert again.over(2, inputs, 1.0, patience=9) is None


def test_a_jump_is_safe_and_leads_away_from_the_tops() -> None:
    rng = np.random.default_rng(0)
    x = rng.random((40, 2))
    y, _ = two_hills(x)
    surrogate = fit_surrogate(x, y, x[:, :1] - 0.1, np.array([0.0]))
    metric = Metric(np.ones(2), np.zeros(2))
    top = np.array([[0.75, 0.75]])
    for _ in range(5):
        point = jump(surrogate, x, top, metric, -2.0, 20, rng)
        assert point is not None
        assert ((point >= 0) & (point <= 1)).all()
        assert surrogate.believed_safe(point, -2.0).all()
        assert np.linalg.norm(point - top) >= 0.5 * surrogate.objective.length_scale
    everywhere = np.stack(np.meshgrid(*[np.linspace(0, 1, 40)] * 2), axis=-1).reshape(-1, 2)
    assert jump(surrogate, x, everywhere, metric, -2.0, 20, rng) is None


def climb_hills(seed: int, **settings: object) -> HdSafeBOLocal:
    problem = hills_problem()
    made = HdSafeBOLocal(problem, seed=seed, **settings)
    x = 0.25 + 0.15 * np.random.default_rng(seed).standard_normal((8, 2))  # around the low hill
    made.observe(x, *problem.function(x), initial=True)
    run_rounds(made, 45, 1)
    return made


def test_single_trials_climb_the_other_hill_too() -> None:
    once = climb_hills(0, patience=1000)
    assert once.trials.objective.max() == pytest.approx(1.0, abs=0.01)
    assert once.climb == Climb(stalled=once.climb.stalled)
    several = climb_hills(0)
    assert several.trials.objective.max() == pytest.approx(1.5, abs=0.01)
    assert several.climb.tops
    assert not several.trials.marked_unsafe.any()


def test_batches_go_on_as_ever() -> None:
    problem = hills_problem()
    made = HdSafeBOLocal(problem, seed=0, patience=1)
    observe_initial(made, 8)
    run_rounds(made, 6, 3)
    assert made.climb.first == 0
    assert made.climb.tops == ()


def test_first_trials_that_beta_would_refuse_are_marked() -> None:
    made = HdSafeBOLocal(bowl_problem(), seed=3, patience=2, jump_beta=4.0)
    observe_initial(made, 8)
    run_rounds(made, 25, 1)
    assert made.climb.tops
    believed = made.trials[~made.trials.initial & ~made.trials.marked_unsafe]
    assert made.trials.marked_unsafe.any()
    assert (believed.predicted_safe_probability >= 0.97).all()


def test_a_climb_survives_a_file(tmp_path: Path) -> None:
    made = HdSafeBOLocal(bowl_problem(), embedding=Halving(), seed=3, patience=2)
    observe_initial(made, 8)
    run_rounds(made, 12, 1)
    assert made.climb.tops
    made.save(tmp_path / "state")
    again = HdSafeBOLocal.load(tmp_path / "state", bowl_problem(), Halving())
    assert again.climb == made.climb
    run_rounds(made, 4, 1)
    run_rounds(again, 4, 1)
    np.testing.assert_array_equal(again.trials.z, made.trials.z)


def test_an_ask_that_fails_begins_no_climb(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(trials: Trials):
        raise MemoryError("no memory")

    made = HdSafeBOLocal(bowl_problem(), seed=3, patience=2, jump_beta=4.0)
    observe_initial(made, 8)
    begun = 0
    for _ in range(20):
        before = made.climb, made.region
        with monkeypatch.context() as patch:
            patch.setattr(made, "believe", fail)
            with pytest.raises(MemoryError):
                made.ask(1)
        assert (made.climb, made.region) == before
        trials = made.ask(1)
        begun += made.climb.first != before[0].first
        made.tell(trials, *made.problem.function(trials.x))
    assert begun > 0
