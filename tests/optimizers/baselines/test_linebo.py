"""LineBO stays on one line, CONFIG everywhere, both within what they believe safe."""

import numpy as np
import pytest

from hdsafebo.errors import NoSafePointError
from hdsafebo.optimizers.baselines.config import Config
from hdsafebo.optimizers.baselines.linebo import LineBO
from optimizers.toy import bowl_problem, observe_initial, run_rounds


def test_a_round_lies_on_one_line_through_the_best_safe_point() -> None:
    optimizer = LineBO(bowl_problem(), seed=0)
    observe_initial(optimizer, 30)
    centre = optimizer.best().x
    offsets = optimizer.ask(8).x - centre
    singular = np.linalg.svd(offsets, compute_uv=False)
    assert singular[1] < 1e-9 * singular[0]


def test_from_a_corner_the_line_leads_inwards() -> None:
    optimizer = LineBO(bowl_problem(), seed=0)
    line = optimizer._line(np.array([0.0, 1.0, 0.0, 0.5]), 50)
    assert np.ptp(line, axis=0).min() > 1e-3
    assert line.min() >= 0.0
    assert line.max() <= 1.0


@pytest.mark.parametrize("kind", [LineBO, Config])
def test_improves_and_is_mostly_safe(kind) -> None:
    optimizer = kind(bowl_problem(), seed=0)
    observe_initial(optimizer, 20)
    before = optimizer.best().objective
    run_rounds(optimizer, 12, 5)
    assert optimizer.best().objective > 0.6 * before
    assert optimizer.feasible[20:].mean() > (0.95 if kind is LineBO else 0.5)


@pytest.mark.parametrize("kind", [LineBO, Config])
def test_abstains_when_nothing_is_believed_safe(kind) -> None:
    optimizer = kind(bowl_problem(threshold=0.2), seed=0, beta=-60.0, empty_safe_set="abstain")
    observe_initial(optimizer, 40)
    with pytest.raises(NoSafePointError):
        optimizer.ask(3)


@pytest.mark.parametrize("kind", [LineBO, Config])
def test_marks_what_it_does_not_believe_safe(kind) -> None:
    optimizer = kind(bowl_problem(), seed=0, beta=-60.0, empty_safe_set="mark")
    observe_initial(optimizer, 20)
    assert optimizer.ask(5).marked_unsafe.any()
