"""The coordinates of constrained ascents where features show a few of many directions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hdsafebo.optimizers.local.constrained.chart import VisibleSteps
from hdsafebo.optimizers.local.constrained.search import ConstrainedSearch
from hdsafebo.optimizers.local.hidden import HiddenSearch
from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
from hdsafebo.problem import FunctionProblem, LinearFeatures, Safety
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray

DIMENSION, VISIBLE = 200, 3
_RNG = np.random.default_rng(0)
MATRIX = _RNG.normal(size=(VISIBLE, DIMENSION)) / np.sqrt(DIMENSION)
LIFT = np.linalg.pinv(MATRIX)
"""(200, 3) least inputs of given features."""


def bowl(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Optimum, 0, at features of 1.5, outside of what initial trials have; hidden inputs are a cost."""
    seen = x @ MATRIX.T
    hidden = x - seen @ LIFT.T
    return -((seen - 1.5) ** 2).sum(axis=1) - (hidden**2).sum(axis=1), (4.0 - seen.sum(axis=1))[:, None]


class Bowl(FunctionProblem):
    features = LinearFeatures(MATRIX)


def problem() -> FunctionProblem:
    bounds = np.tile([[-4.0], [4.0]], DIMENSION)
    return Bowl(bowl, bounds, [Safety("sum", 0.0)], name="visible_bowl")


def started(hidden: float, seed: int = 0, n: int = 12) -> HdSafeBOLocal:
    """Told initial trials that lie in the visible space, but for `hidden` of noise in every input."""
    made = HdSafeBOLocal(problem(), seed=seed)
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.0, 1.0, (n, VISIBLE)) @ LIFT.T + hidden * rng.standard_normal((n, DIMENSION))
    x = np.clip(x, -4.0, 4.0)
    made.observe(x, *bowl(x), initial=True)
    return made


def run(made: HdSafeBOLocal, rounds: int) -> None:
    for _ in range(rounds):
        asked = made.ask(5)
        made.tell(asked, *bowl(asked.x))


@pytest.mark.parametrize(
    ("hidden", "kind"), [(0.0, ConstrainedSearch), (0.001, ConstrainedSearch), (1.0, HiddenSearch)]
)
def test_what_initial_trials_hide_decides_on_the_search(hidden: float, kind: type) -> None:
    assert type(started(hidden).search) is kind


def test_without_initial_trials_nothing_is_known_of_hidden_directions() -> None:
    made = HdSafeBOLocal(problem(), seed=0)
    x = np.zeros((3, DIMENSION)) + np.arange(3)[:, None] * LIFT[:, 0]
    made.observe(x, *bowl(x), initial=False)
    assert type(made.search) is HiddenSearch


def test_coordinates_and_points_are_inverse_and_steps_hide_nothing() -> None:
    made = started(0.001)
    search = made.search
    assert isinstance(search, ConstrainedSearch)
    chart = search.chart
    assert isinstance(chart, VisibleSteps)
    assert chart.dimension == VISIBLE
    incumbent = made.space.to_unit(made.trials.z[:1])[0]
    coordinates = np.random.default_rng(1).uniform(0.4, 0.6, (4, VISIBLE))
    x = made.space.to_code(chart.points(coordinates, incumbent))
    np.testing.assert_allclose(chart.coordinates(Trials.pending(x, x, 1)), coordinates, atol=1e-9)
    steps = x - made.trials.x[0]
    np.testing.assert_allclose(steps, steps @ MATRIX.T @ LIFT.T, atol=1e-9)
    known = chart.coordinates(made.trials)
    np.testing.assert_allclose(np.abs(known - 0.5).max(axis=0), 0.5, atol=1e-9)


def test_where_initial_trials_do_not_differ_the_others_say_how_far_is_far() -> None:
    made = HdSafeBOLocal(problem(), seed=0)
    seen = np.random.default_rng(0).uniform(-1.0, 1.0, (12, VISIBLE))
    seen[:, 2] = 0.3
    x = seen @ LIFT.T
    made.observe(x, *bowl(x), initial=True)
    search = made.search
    assert isinstance(search, ConstrainedSearch)
    side = search.chart.arrays()["chart_side"]
    assert side[2] == pytest.approx(np.sqrt(side[0] * side[1]))


@pytest.mark.thorough
def test_finds_an_optimum_beyond_the_initial_trials_without_leaving_the_safe_set() -> None:
    made = started(0.0)
    run(made, 12)
    best = made.best()
    seen = MATRIX @ best.x
    assert best.objective > -0.15  # -0.083 at the edge of the safe set, 4 / 3 each
    np.testing.assert_allclose(seen, 4.0 / 3.0, atol=0.25)
    assert made.feasible[12:].mean() >= 0.97


def test_a_saved_state_goes_on_to_the_bit(tmp_path: Path) -> None:
    made = started(0.001)
    run(made, 3)
    made.save(tmp_path / "state")
    again = HdSafeBOLocal.load(tmp_path / "state", problem())
    run(made, 2)
    run(again, 2)
    np.testing.assert_array_equal(again.trials.x, made.trials.x)


def test_more_initial_trials_leave_the_chart_as_it_was(tmp_path: Path) -> None:
    made = started(0.001)
    run(made, 2)
    before = made.kernel_inputs(made.trials)
    x = 3.0 * LIFT[:, :1].T
    made.observe(x, *bowl(x), initial=True)
    np.testing.assert_array_equal(made.kernel_inputs(made.trials)[: len(before)], before)
    made.save(tmp_path / "state")
    again = HdSafeBOLocal.load(tmp_path / "state", problem())
    np.testing.assert_array_equal(again.kernel_inputs(made.trials), made.kernel_inputs(made.trials))
    run(made, 1)
    run(again, 1)
    np.testing.assert_array_equal(again.trials.x, made.trials.x)
