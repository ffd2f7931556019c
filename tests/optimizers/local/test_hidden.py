"""Search where features hide directions: steps in all of them, a mean of parents, noisy scores."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtri

from hdsafebo.errors import NoSafePointError
from hdsafebo.optimizers.local.hidden import HiddenSearch
from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
from hdsafebo.optimizers.local.recombination import safe_steps
from hdsafebo.problem import FunctionProblem, LinearFeatures
from hdsafebo.typing import FloatArray
from optimizers.toy import bowl_problem, observe_initial, run_rounds


def hiding(threshold: float = 0.0, dimension: int = 4) -> HdSafeBOLocal:
    """Features see the difference of coordinates 2 and 3 and no later ones; the optimum needs the sum."""
    problem = bowl_problem(threshold, dimension)
    matrix = np.zeros((3, dimension))
    matrix[:, :4] = np.vstack([np.eye(4)[:2], [0.0, 0.0, 1.0, -1.0]])
    problem.features = lambda x: x @ matrix.T
    made = HdSafeBOLocal(problem, seed=3, empty_safe_set="mark")
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
    assert abs(optimizer.best().x[2:].sum() - 1.2) < 0.05


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

    def watched(surrogate, metric, rows, centre, *args, **settings):
        used.append(centre)
        return safe_steps(surrogate, metric, rows, centre, *args, **settings)

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


def test_a_round_of_marked_trials_that_were_all_unsafe_is_not_repeated() -> None:
    optimizer = hiding()
    x = np.random.default_rng(0).random((6, 4))
    optimizer.observe(x, np.zeros(6), np.full(6, -1.0), initial=True)
    marked = optimizer.ask(4)
    optimizer.tell(marked, np.zeros(4), np.full(4, -1.0))
    with pytest.raises(NoSafePointError, match="the last round, which was marked, was unsafe altogether"):
        optimizer.ask(4)
    optimizer.observe(marked.x[:1] * 0.99, [0.0], [1.0])
    optimizer.search.lost = False
    assert len(optimizer.ask(4)) == 4


def test_whether_the_last_round_was_lost_survives_a_file(tmp_path: Path) -> None:
    optimizer = hiding()
    x = np.random.default_rng(0).random((6, 4))
    optimizer.observe(x, np.zeros(6), np.full(6, -1.0), initial=True)
    optimizer.tell(optimizer.ask(4), np.zeros(4), np.full(4, -1.0))
    optimizer.save(tmp_path / "state")
    loaded = HdSafeBOLocal.load(tmp_path / "state", optimizer.problem)
    with pytest.raises(NoSafePointError, match="was marked"):
        loaded.ask(4)


def test_parents_far_apart_are_left_where_nothing_is_safe_between_them() -> None:
    """Two safe hills, and a safety function that says nothing is safe between them."""
    rng = np.random.default_rng(0)
    matrix = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])
    problem = FunctionProblem(
        lambda x: (x[:, 0], 8.0 * np.abs(x[:, 0] - 0.5) - 2.0), bounds=np.stack([np.zeros(4), np.ones(4)])
    )
    problem.features = LinearFeatures(matrix)
    optimizer = HdSafeBOLocal(problem, seed=0)
    x = rng.random((60, 4))
    x[:30, 0] = np.where(np.arange(30) % 2, 0.08, 0.92) + 0.05 * rng.standard_normal(30)
    x = np.clip(x, 0.0, 1.0)
    optimizer.observe(x, -np.arange(60.0), problem.function(x)[1], initial=True)
    search = optimizer.search
    assert isinstance(search, HiddenSearch)
    mean = search.centre()
    assert not optimizer.surrogate.believed_safe(search.metric.inputs(mean[None]), -2.0)[0]
    asked = optimizer.ask(10)
    assert not asked.marked_unsafe.any()
    assert (problem.function(asked.x)[1] >= 0).mean() >= 0.9


def test_features_are_computed_once_per_trial() -> None:
    optimizer = hiding()
    start = observe_initial(optimizer, 15)
    calls: list[int] = []
    features = optimizer.problem.features
    optimizer.problem.features = lambda x: (calls.append(len(x)), features(x))[1]
    optimizer.surrogate  # noqa: B018 (a fit needs the features of all trials)
    assert calls == [1] * 15
    optimizer._fits.forget()
    optimizer.surrogate  # noqa: B018
    assert calls == [1] * 15
    np.testing.assert_allclose(optimizer.inputs_of(np.arange(15)), features(start.x), atol=1e-12)


def test_a_round_in_many_dimensions_makes_few_points_whole() -> None:
    """Neither the steps that are judged nor those of an ascent have as many numbers as the space."""
    import tracemalloc

    d = 20_000
    rng = np.random.default_rng(0)
    problem = FunctionProblem(
        lambda x: (-(x[:, :50] ** 2).sum(1), 1.0 - x[:, :50].mean(1)),
        bounds=np.stack([-np.ones(d), np.ones(d)]),
    )
    problem.features = LinearFeatures(rng.standard_normal((8, d)) / np.sqrt(d))
    optimizer = HdSafeBOLocal(problem, seed=0)
    x = 0.2 * rng.standard_normal((15, d))
    optimizer.observe(x, *problem.function(x), initial=True)
    optimizer.surrogate  # noqa: B018
    tracemalloc.start()
    trials = optimizer.ask(5)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(trials) == 5
    assert peak < 100 * d * 8


def test_in_many_dimensions_hyper_parameters_are_searched_where_trials_have_grown() -> None:
    """Rounds of ten: every one up to 330 trials, then as often as trials grow by 3 %."""
    optimizer = hiding(threshold=-1e9, dimension=1000)
    x = np.random.default_rng(0).random((1000, 1000))

    def refined_with(known: int) -> bool:
        optimizer = hiding(threshold=-1e9, dimension=1000)
        results = optimizer.problem.function(x[:known])
        optimizer.observe(x[:known], *results, initial=True)
        trials = optimizer.trials
        object.__setattr__(trials, "round", np.repeat([0, 1], [known - 10, 10]))
        return optimizer.search.refines()

    assert optimizer.search.refines() is False, "nothing is known yet"
    assert all(refined_with(known) for known in (20, 50, 100, 320))
    searched = sum(refined_with(known) for known in range(910, 1010, 10))
    assert 3 <= searched <= 4, "log(1000 / 900) / log(1.03) is 3.6"


def test_in_few_dimensions_hyper_parameters_are_always_searched() -> None:
    optimizer = hiding()
    observe_initial(optimizer, 15)
    assert optimizer.search.refines()
