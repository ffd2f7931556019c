"""Sparse embeddings: one latent coordinate per input, and splits that leave every input where it was."""

import numpy as np
import pytest

from hdsafebo.optimizers.baselines.count_sketch import CountSketch


def test_lift_copies_one_coordinate_per_input_up_to_sign() -> None:
    rng = np.random.default_rng(0)
    sketch = CountSketch.random(40, 6, rng)
    y = rng.uniform(-1, 1, (5, 6))
    dense = np.zeros((6, 40))
    dense[sketch.bins, np.arange(40)] = sketch.signs
    np.testing.assert_array_equal(sketch.lift(y), y @ dense)


@pytest.mark.parametrize(("inputs", "dimension"), [(10, 3), (500, 8), (7, 7), (5, 9)])
def test_balanced_bins_differ_by_at_most_one(inputs: int, dimension: int) -> None:
    sketch = CountSketch.balanced(inputs, dimension, np.random.default_rng(1))
    sizes = np.bincount(sketch.bins, minlength=sketch.dimension)
    assert sketch.dimension == min(inputs, dimension)
    assert sizes.max() - sizes.min() <= 1


def test_split_keeps_inputs_and_ends_at_the_identity() -> None:
    rng = np.random.default_rng(2)
    sketch = CountSketch.balanced(50, 2, rng)
    y = rng.uniform(-1, 1, (4, 2))
    x, dimensions = sketch.lift(y), [2]
    while sketch.dimension < 50:
        sketch, parent = sketch.split(3, rng)
        y = y[:, parent]
        dimensions.append(sketch.dimension)
        np.testing.assert_array_equal(sketch.lift(y), x)
    assert dimensions[:3] == [2, 8, 32]
    np.testing.assert_array_equal(np.bincount(sketch.bins), np.ones(50))
    assert sketch.split(3, rng)[0].dimension == 50


def test_hesbo_signs_are_fair() -> None:
    signs = CountSketch.random(20_000, 4, np.random.default_rng(3)).signs
    assert abs(signs.mean()) < 4 / np.sqrt(20_000)
