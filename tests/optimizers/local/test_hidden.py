"""Search where features hide directions: steps in all of them, a mean of parents, noisy scores."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtri

from hdsafebo.optimizers.local.hidden import HiddenSearch
from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
from hdsafebo.optimizers.local.recombination import safe_steps
from hdsafebo.typing import FloatArray
from optimizers.toy import bowl_problem, observe_initial, run_rounds


def hiding(threshold: float = 0.0, dimension: int = 4) -> HdSafeBOLocal:
    """Features see the difference of coordinates 2 and 3 and no later ones; the optimum needs the sum."""
    problem = bowl_problem(threshold, dimension)
    matrix = np.zeros((3, dimension))
    matrix[:, :4] = np.vstack([np.eye(4)[:2], [0.0, 0.0, 1.0, -1.0]])
    problem.features = lambda x: x @ matrix.T
    made = HdSafeBOLocal(problem, seed=3)
    assert type(made.search) is HiddenSearch
    return made


def test_they_are_searched() -> None:
    optimizer = hiding()
    start = observe_initial(optimizer, 15)
    best = start.x[np.argmax(np.where(start.safety[:, 0] >= 0, start.objective, -np.inf))]
    assert abs(best[2:].sum() - 1.2) > 0.1
    first = optimizer.ask(10)
    assert np.ptp((first.x - best)[:, 2:].sum(axis=1)) > 0.01
    assert (first.predicted_safe_probability[~first.marked_unsafe] >= 0.977 - 1e-6).all()
    optimizer.tell(first, *optimizer.problem.function(first.x))
    run_rounds(optimizer, 10, 10)
    assert abs(optimizer.best().x[0, 2:].sum() - 1.2) < 0.05


def test_centre_is_a_mean_of_the_best_feasible_trials(centres: list[FloatArray]) -> None:
    optimizer = hiding(threshold=-3.0)
    observe_initial(optimizer, 150)
    optimizer.ask(8)
    np.testing.assert_allclose(centres[-1], mean_of_best(optimizer, np.arange(150)))


def test_in_many_dimensions_parents_are_recent_and_steps_large(centres: list[FloatArray]) -> None:
    optimizer = hiding(threshold=-1e9, dimension=1000)
    observe_initial(optimizer, 150)
    run_rounds(optimizer, 2, 10)
    known = np.arange(170)
    optimizer.ask(10)
    np.testing.assert_allclose(centres[-1], mean_of_best(optimizer, known))
    last = optimizer.trials[-10:]
    optimizer.tell(last, *optimizer.problem.function(last.x))
    optimizer.ask(8)
    np.testing.assert_allclose(centres[-1], mean_of_best(optimizer, np.arange(150, 180)))
    assert optimizer.search.rate == 0.5


def mean_of_best(optimizer: HdSafeBOLocal, rows: NDArray[np.int64]) -> FloatArray:
    rows = rows[optimizer.feasible[rows]]
    best = rows[np.argsort(-optimizer.trials.objective[rows])][:10]
    weights = np.log(10.5) - np.log(np.arange(1, 11))
    return weights / weights.sum() @ optimizer.space.to_unit(optimizer.trials.z[best])


@pytest.fixture
def centres(monkeypatch: pytest.MonkeyPatch) -> list[FloatArray]:
    """Centres of the steps so far."""
    used: list[FloatArray] = []

    def watched(surrogate, metric, centre, *args):
        used.append(centre)
        return safe_steps(surrogate, metric, centre, *args)

    monkeypatch.setattr("hdsafebo.optimizers.local.hidden.safe_steps", watched)
    return used


def test_outcomes_are_normal_scores_with_noise() -> None:
    optimizer = hiding()
    observe_initial(optimizer, 150)
    model = optimizer.surrogate.objective
    raw = model.outcomes.restore(model.values)
    assert np.abs(raw).max() == pytest.approx(ndtri(1 - 0.5 / 150))
    np.testing.assert_array_equal(np.argsort(raw), np.argsort(optimizer.trials.objective))
    assert all(gp.hyper.noise_ratio >= 0.999 / 30 for gp in (model, *optimizer.surrogate.safety))


def test_nothing_safe_is_said() -> None:
    optimizer = hiding()
    x = np.random.default_rng(0).random((6, 4))
    optimizer.observe(x, np.zeros(6), np.full(6, -1.0), initial=True)
    assert optimizer.ask(4).marked_unsafe.all()
