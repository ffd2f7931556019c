"""A surrogate of bounded cost: which trials are kept, what it believes, and what a round costs."""

from __future__ import annotations

import time
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.gp import surrogate as surrogates
from hdsafebo.gp.kernel import exact_distances
from hdsafebo.optimizers.hdsafebo import HdSafeBO
from hdsafebo.optimizers.local.constrained import search
from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
from hdsafebo.optimizers.registry import make_optimizer
from hdsafebo.trials import Status
from optimizers.toy import Halving, bowl, bowl_problem, observe_initial, rows_problem, run_rounds

METHODS = ("hdsafebo", "hdsafebo_local", "hdsafebo_length_scales", "safeopt", "config", "linebo")


def test_the_nearest_to_the_best_feasible_trial_are_kept() -> None:
    made = HdSafeBO(bowl_problem(), seed=0, max_fitted_trials=7)
    observe_initial(made, 60)
    rows = made.rows_to_fit()
    best = made.best()
    assert best is not None
    inputs = made.kernel_inputs(made.trials)
    distance = exact_distances(inputs[[best.id]], inputs)[0]
    assert rows.tolist() == sorted(np.argsort(distance)[:7].tolist())
    np.testing.assert_array_equal(made.surrogate.inputs, inputs[rows])


def test_without_a_feasible_trial_the_least_violation_is_the_centre() -> None:
    made = HdSafeBO(bowl_problem(threshold=5.0), seed=0, max_fitted_trials=3)
    trials = observe_initial(made, 40)
    assert made.best() is None
    assert trials.safety[:, 0].argmax() in made.rows_to_fit()


def test_of_equally_distant_trials_the_older_are_kept_and_the_centre_always() -> None:
    made = HdSafeBO(bowl_problem(), seed=0, max_fitted_trials=4)
    x = np.tile([[0.5, 0.5, 0.5, 0.5]], (9, 1))
    made.observe(x, [0, 0, 0, 0, 0, 0, 0, 1, 0], np.ones(9), initial=True)
    assert made.rows_to_fit().tolist() == [0, 1, 2, 7]


def test_failed_and_pending_trials_are_not_kept() -> None:
    made = HdSafeBO(bowl_problem(), seed=0, max_fitted_trials=30)
    observe_initial(made, 20)
    made.observe([[0.5] * 4], [0.0], [0.0], status=[Status.FAILED])
    made.ask(3)
    assert made.rows_to_fit().tolist() == list(range(20))
    assert HdSafeBO(bowl_problem(), max_fitted_trials=3).rows_to_fit().tolist() == []


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["box", "rows", "codes"])
@pytest.mark.thorough
def test_a_bound_that_is_not_reached_changes_nothing(method: str, kind: str) -> None:
    tables = []
    for most in (None, 10_000):
        problem = rows_problem(100) if kind == "rows" else bowl_problem()
        embedding = Halving() if kind == "codes" else None
        made = make_optimizer(method, problem, seed=2, embedding=embedding, max_fitted_trials=most)
        observe_initial(made)
        run_rounds(made, 2)
        tables.append(made.trials)
    np.testing.assert_array_equal(tables[0].x, tables[1].x)
    np.testing.assert_array_equal(tables[0].predicted_safe_probability, tables[1].predicted_safe_probability)


@pytest.mark.parametrize("method", METHODS)
def test_no_fit_has_more_trials_than_the_bound(monkeypatch: pytest.MonkeyPatch, method: str) -> None:
    sizes = []

    def count(module: ModuleType, name: str) -> None:
        fit = getattr(module, name)

        def counted(inputs, *args, **kwargs):  # type: ignore[no-untyped-def]
            sizes.append(len(inputs))
            return fit(inputs, *args, **kwargs)

        monkeypatch.setattr(module, name, counted)

    count(surrogates, "fit_gaussian_process")
    count(search, "fit_warped_surrogate")
    made = make_optimizer(method, bowl_problem(), seed=2, max_fitted_trials=15)
    observe_initial(made)
    run_rounds(made, 4)
    assert max(sizes) == 15
    assert len(made.trials) == 28


def test_a_bounded_optimizer_goes_on_from_its_file_to_the_bit(tmp_path: Path) -> None:
    made = HdSafeBOLocal(bowl_problem(), seed=5, max_fitted_trials=10)
    observe_initial(made)
    run_rounds(made, 3)
    made.save(tmp_path / "state")
    loaded = HdSafeBOLocal.load(tmp_path / "state", made.problem)
    for optimizer in (made, loaded):
        run_rounds(optimizer, 3)
    np.testing.assert_array_equal(made.trials.x, loaded.trials.x)
    assert made.fit_counts == loaded.fit_counts


def test_a_bounded_search_still_finds_the_top() -> None:
    made = HdSafeBOLocal(bowl_problem(), seed=1, max_fitted_trials=40)
    observe_initial(made, 40)
    run_rounds(made, 15, n=6)
    best = made.best()
    assert best is not None
    assert best.objective > -0.005  # the top, 0, is at 0.6 and safe
    assert made.feasible[40:].mean() > 0.9


def test_a_hundred_times_more_trials_change_neither_fit_nor_its_cost() -> None:
    """Trials beyond the neighbourhood leave the surrogate as it is, to the bit."""
    few, many = (HdSafeBOLocal(bowl_problem(), seed=1, max_fitted_trials=50) for _ in range(2))
    near = 0.5 + 0.05 * np.random.default_rng(0).standard_normal((60, 4))
    far = np.random.default_rng(1).choice([0.0, 1.0], (6000, 4))
    for made in (few, many):
        made.observe(near, *bowl(near), initial=True)
    many.observe(far, *bowl(far), initial=True)
    assert len(many.trials) > 100 * len(few.trials)
    np.testing.assert_array_equal(few.rows_to_fit(), many.rows_to_fit())
    x = np.random.default_rng(2).random((20, 4))
    for one, other in zip(few.surrogate.predict_safety(x), many.surrogate.predict_safety(x), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("value", [0, -3, 2.5, "ten"])
def test_a_bound_that_is_no_number_of_trials_is_refused(value: object) -> None:
    with pytest.raises(ParamsError, match="max_fitted_trials"):
        HdSafeBO(bowl_problem(), max_fitted_trials=value)


@pytest.mark.slow
def test_a_round_at_ten_thousand_trials_costs_at_most_twice_that_at_a_thousand() -> None:
    seconds = {}
    for n in (1_000, 10_000):
        made = HdSafeBOLocal(bowl_problem(dimension=20), seed=1, max_fitted_trials=300)
        x = np.random.default_rng(0).uniform(0.3, 0.5, (n, 20))
        made.observe(x, *bowl(x), initial=True)
        run_rounds(made, 4, n=10)  # the first fits search longer
        spent = []
        for _ in range(9):
            start = time.process_time()
            run_rounds(made, 1, n=10)
            spent.append(time.process_time() - start)
        seconds[n] = np.median(spent)
    assert seconds[10_000] <= 2 * seconds[1_000], seconds
