"""The mean of several parents, and random steps of several sizes."""

import cma
import numpy as np
import pytest

from hdsafebo.gp.surrogate import Surrogate, fit_surrogate
from hdsafebo.optimizers.local.recombination import recombined, safe_steps
from hdsafebo.search.metric import Metric
from hdsafebo.search.row_space import RowSpace

METRIC = Metric(np.eye(3)[:2], np.zeros(2))
ROWS = RowSpace.of(METRIC)
CENTRE = np.full(3, 0.5)


def surrogate(threshold: float) -> Surrogate:
    """The objective grows with the first of three coordinates, the safety with the second."""
    x = np.random.default_rng(0).random((60, 2))
    return fit_surrogate(x, x[:, 0], x[:, [1]], np.array([threshold]))


def test_one_parent_is_its_own_mean() -> None:
    np.testing.assert_allclose(recombined(np.array([[0.2, 0.7]])), [0.2, 0.7])


def test_weights_are_those_of_pycma() -> None:
    theirs = cma.recombination_weights.RecombinationWeights(20)
    np.testing.assert_allclose(recombined(np.eye(10)), np.asarray(theirs)[:10], rtol=1e-6)


@pytest.mark.parametrize(("least", "smallest"), [(0.0, 0.01), (0.3, 0.25), (0.9, 0.6)])
def test_steps_are_of_every_size_from_the_least(least: float, smallest: float) -> None:
    model = surrogate(-1.0)
    batches = [
        safe_steps(model, METRIC, ROWS, CENTRE, -2.0, 8, np.random.default_rng(seed), least=least)
        for seed in range(20)
    ]
    steps = np.array(batches)
    assert steps.shape == (20, 8, 3)
    assert steps.min() >= 0.0
    assert steps.max() <= 1.0
    size = np.abs(steps[:, :, 2] - 0.5).mean(axis=0)  # in the direction that no model chooses in
    share = size[0] / size[-1]
    assert smallest < share < least + 0.35


def test_steps_climb_and_reach_what_the_metric_hides() -> None:
    model = surrogate(-1.0)
    batches = [
        safe_steps(model, METRIC, ROWS, CENTRE, -2.0, 8, np.random.default_rng(seed)) - CENTRE
        for seed in range(20)
    ]
    steps = np.concatenate(batches)
    assert (steps[:, 0] > 0).mean() > 0.95
    assert np.abs(steps[:, 2]).max() > 0.3
    assert abs((steps[:, 2] > 0).mean() - 0.5) < 0.15


@pytest.mark.parametrize("threshold", [0.45, 0.55])
def test_steps_are_believed_safe(threshold: float) -> None:
    """Though the centre itself is not, with the second threshold."""
    model = surrogate(threshold)
    steps = safe_steps(model, METRIC, ROWS, CENTRE, -2.0, 8, np.random.default_rng(2))
    assert len(steps) == 8
    assert model.believed_safe(METRIC.inputs(steps), -2.0).all()
    assert (steps[:, 1] >= threshold - 1e-3).all()


@pytest.mark.parametrize(("threshold", "n"), [(-1.0, 0), (5.0, 8)])
def test_none_asked_for_or_none_safe(threshold: float, n: int) -> None:
    steps = safe_steps(surrogate(threshold), METRIC, ROWS, CENTRE, -2.0, n, np.random.default_rng(3))
    assert steps.shape == (0, 3)


def test_steps_do_not_shrink_with_the_length_scale_that_small_steps_make_short() -> None:
    rng = np.random.default_rng(0)
    x = 0.5 + 1e-3 * rng.standard_normal((60, 2))
    rugged = fit_surrogate(x, np.sin(4e3 * x[:, 0]), x[:, [1]], np.array([-1.0]))
    assert rugged.length_scale < 0.01
    batches = [
        safe_steps(rugged, METRIC, ROWS, CENTRE, -2.0, 8, np.random.default_rng(seed)) - CENTRE
        for seed in range(20)
    ]
    size = np.abs(np.array(batches)[:, :, 2]).mean(axis=0)
    assert size[0] > 0.002
    assert size[-1] > 0.1


def test_steps_that_are_made_whole_later_have_the_same_sizes() -> None:
    model, sizes = surrogate(-1.0), []  # safe wherever the cube cuts a step
    for whole in (True, False):
        batches = [
            safe_steps(model, METRIC, ROWS, CENTRE, -2.0, 8, np.random.default_rng(seed), whole=whole)
            for seed in range(12)
        ]
        sizes.append(np.abs(np.concatenate(batches) - CENTRE).mean(axis=0))
    np.testing.assert_allclose(sizes[0], sizes[1], rtol=0.45)
