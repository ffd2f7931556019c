"""The mean of several parents, and random steps of several sizes."""

import cma
import numpy as np
import pytest

from hdsafebo.optimizers.recombination import normal_steps, recombined, size_classes


def test_one_parent_is_its_own_mean() -> None:
    np.testing.assert_allclose(recombined(np.array([[0.2, 0.7]])), [0.2, 0.7])


def test_weights_are_those_of_pycma() -> None:
    weights = recombined(np.eye(10))
    theirs = cma.recombination_weights.RecombinationWeights(20)
    np.testing.assert_allclose(weights, np.asarray(theirs)[:10], rtol=1e-6)


def test_steps_have_the_sizes_asked_for_and_stay_in_the_cube() -> None:
    centre = np.full(4000, 0.5)
    steps = normal_steps(centre, (1e-3, 1e-1), 3, np.random.default_rng(0))
    np.testing.assert_allclose((steps - centre).std(axis=1), [1e-3, 1e-2, 1e-1], rtol=0.05)
    far = normal_steps(centre, (1.0, 2.0), 5, np.random.default_rng(1))
    assert far.min() == 0.0
    assert far.max() == 1.0


@pytest.mark.parametrize(("count", "n", "sizes"), [(7, 3, [3, 2, 2]), (2, 3, [1, 1]), (0, 3, [])])
def test_classes_keep_the_order_and_are_never_empty(count: int, n: int, sizes: list[int]) -> None:
    steps = np.arange(count, dtype=float)[:, None]
    parts = list(size_classes(steps, 2.0 * steps, n))
    assert [len(part) for part, _ in parts] == sizes
    np.testing.assert_array_equal(np.concatenate([steps[:0], *(part for part, _ in parts)]), steps)
    assert all((seen == 2.0 * part).all() for part, seen in parts)
