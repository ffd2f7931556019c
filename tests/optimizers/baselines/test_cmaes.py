"""CMA-ES converges under its constraint and asks in any batches."""

from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.optimizers.baselines.cmaes import CmaEs
from hdsafebo.problem import FunctionProblem, Safety
from optimizers.toy import bowl, bowl_problem, observe_initial, run_rounds


def test_reaches_the_constrained_optimum() -> None:
    """Maximum of -|x - 0.6|^2 with sum(x) <= 1.2 in four dimensions is at 0.3."""

    def function(x):
        return -((x - 0.6) ** 2).sum(axis=1), 1.2 - x.sum(axis=1)

    problem = FunctionProblem(function, np.stack([np.zeros(4), np.ones(4)]))
    optimizer = CmaEs(problem, seed=0)
    observe_initial(optimizer, 10)
    run_rounds(optimizer, 100, 10)
    np.testing.assert_allclose(optimizer.best().x, 0.3, atol=0.02)


def test_functions_on_record_are_no_constraints() -> None:
    """A second function that no point meets, neither modelled nor reported, changes no proposal."""
    plain = bowl_problem()
    bounds, distance = plain.bounds, plain.safety[0]
    aside = Safety("aside", 1e3, modelled=False, reported=False)

    def function(x):
        objective, safety = bowl(x)
        return objective, np.column_stack([safety, -safety])

    found = []
    for problem in (plain, FunctionProblem(function, bounds, [distance, aside])):
        optimizer = CmaEs(problem, seed=0)
        observe_initial(optimizer)
        run_rounds(optimizer, 5, 10)
        found.append(optimizer.trials.x)
    np.testing.assert_array_equal(*found)


def test_starts_where_it_is_told() -> None:
    for start, centre in (("centre", np.full(4, 0.5)), ("best_safe", None)):
        optimizer = CmaEs(bowl_problem(), start=start, step=1e-3, seed=0)
        observe_initial(optimizer)
        x = optimizer.ask(10).x
        expected = optimizer.best().x if centre is None else centre
        np.testing.assert_allclose(x.mean(axis=0), expected, atol=5e-3)


def test_single_trials_are_collected_into_generations() -> None:
    optimizer = CmaEs(bowl_problem(), seed=0)
    observe_initial(optimizer)
    run_rounds(optimizer, 7, 1)
    assert optimizer._strategy.countiter == 0
    run_rounds(optimizer, 1, 1)
    assert optimizer._strategy.popsize == 8  # 4 + 3 log 4
    assert optimizer._strategy.countiter == 1


def test_population_below_what_pycma_can_rank_is_refused() -> None:
    with pytest.raises(ParamsError, match="population"):
        CmaEs(bowl_problem(), population=3)


def test_leaves_nothing_in_the_working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    optimizer = CmaEs(bowl_problem(), seed=0)
    observe_initial(optimizer)
    run_rounds(optimizer, 2, 10)
    assert optimizer._strategy.countiter == 2
    assert list(tmp_path.iterdir()) == []
