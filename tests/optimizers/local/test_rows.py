"""Search of a finite candidate set: only some inputs can be evaluated."""

from dataclasses import replace

import numpy as np
import pytest

from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
from hdsafebo.optimizers.local.rows import RowSearch
from optimizers.toy import observe_initial, rows_problem, run_rounds


def test_rows_are_believed_safe_and_new() -> None:
    optimizer = HdSafeBOLocal(rows_problem(2000), seed=1)
    observe_initial(optimizer, 20)
    run_rounds(optimizer, 6)
    asked = optimizer.trials[optimizer.trials.round > 0]
    assert len(np.unique(optimizer.trials.candidate)) == len(optimizer.trials)
    assert (asked.predicted_safe_probability[~asked.marked_unsafe] >= 0.977 - 1e-6).all()
    np.testing.assert_array_equal(asked.x, optimizer.problem.candidates.features[asked.candidate])


def test_finds_the_best_safe_row() -> None:
    problem = rows_problem(2000)
    optimizer = HdSafeBOLocal(problem, seed=2)
    observe_initial(optimizer, 20)
    run_rounds(optimizer, 12)
    objective, safety = problem.function(problem.candidates.features)
    assert optimizer.best().objective >= np.sort(objective[safety >= 0])[-3]


def narrow(monkeypatch: pytest.MonkeyPatch, rows: int, regions: int) -> None:
    """Regions of so many rows together, and none from elsewhere."""
    module = "hdsafebo.optimizers.local.rows."
    monkeypatch.setattr(module + "_REGIONS", regions)
    monkeypatch.setattr(module + "_ELSEWHERE", 0)
    monkeypatch.setattr(RowSearch, "rule", replace(RowSearch.rule, initial=rows, least=20))


def test_neighbourhood_is_the_nearest_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    narrow(monkeypatch, 50, 1)
    optimizer = HdSafeBOLocal(rows_problem(500), seed=3)
    observe_initial(optimizer, 20)
    centre = optimizer.best().x
    trials = optimizer.ask(5)
    free = np.setdiff1d(np.arange(500), optimizer.trials.candidate[:20])
    distance = np.linalg.norm(optimizer.problem.candidates.features - centre, axis=1)
    limit = np.sort(distance[free])[49]
    assert (distance[trials.candidate] <= limit + 1e-12).all()


def test_regions_lie_a_length_scale_apart_around_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    narrow(monkeypatch, 60, 3)
    problem = rows_problem(2000)
    bowl = problem.function
    problem.function = lambda x: (np.sin(12 * x).sum(axis=1), bowl(x)[1])  # several tops
    optimizer = HdSafeBOLocal(problem, seed=3)
    observe_initial(optimizer, 100)
    features = problem.candidates.features
    gp = optimizer.surrogate.objective
    known = optimizer.trials[optimizer.feasible]
    safe = optimizer.surrogate.believed_safe(features[known.candidate], -2.0)
    known = known[np.flatnonzero(safe)[np.argsort(-known.objective[safe], kind="stable")]]
    centres = [known.x[0]]
    for x in known.x:
        if len(centres) < 3 and min(np.linalg.norm(x - c) for c in centres) >= gp.length_scale:
            centres.append(x)
    assert len(centres) > 1  # or nothing is tested
    free = np.setdiff1d(np.arange(2000), optimizer.trials.candidate)
    near = [
        free[np.argsort(np.linalg.norm(features[free] - c, axis=1))[: 60 // len(centres)]] for c in centres
    ]
    trials = optimizer.ask(10)
    assert set(trials.candidate) <= set(np.concatenate(near))


def test_inputs_outside_the_set_count_as_their_nearest_row() -> None:
    optimizer = HdSafeBOLocal(rows_problem(500))
    observe_initial(optimizer, 20)
    optimizer.observe([[0.5, 0.5]], [0.0], [0.1])
    features = optimizer.problem.candidates.features
    nearest = features[np.linalg.norm(features - 0.5, axis=1).argmin()]
    np.testing.assert_array_equal(optimizer.kernel_inputs(optimizer.trials)[-1], nearest)


def test_last_rows() -> None:
    optimizer = HdSafeBOLocal(rows_problem(30), empty_safe_set="mark")
    observe_initial(optimizer, 10)
    assert sorted(optimizer.ask(20).candidate) == sorted(
        set(range(30)) - set(optimizer.trials.candidate[:10])
    )
