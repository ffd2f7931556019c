"""The traversal against brute force, and the calibration against its definition."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.errors import AnatomyError, DatasetError
from hdsafebo.spinal.activating_function import ActivatingFunction
from hdsafebo.spinal.calibration import calibrate, saturating_rank
from hdsafebo.spinal.configurations import current_shares, enumerate_configurations
from hdsafebo.spinal.geometry.anatomy import Anatomy
from hdsafebo.spinal.muscles import MUSCLES, districts
from hdsafebo.spinal.traversal import Traversal, traverse


def test_activations_equal_brute_force(activating: ActivatingFunction, traversal: Traversal) -> None:
    borders = districts(Anatomy())
    rng = np.random.default_rng(1)
    for row in rng.choice(len(traversal.polarity), 40, replace=False):
        af = np.abs(
            np.tensordot(current_shares(traversal.polarity[row : row + 1])[0], activating.unit, axes=1)
        )
        for level, current in enumerate(traversal.currents):
            active = current * af > traversal.threshold
            for i, muscle in enumerate(MUSCLES):
                low, high = borders[muscle]
                inside = (activating.z >= low) & (activating.z < high)
                # single precision may move one point across the threshold
                tolerance = 1.01 / active[0][inside].size
                expected = active[:, inside].mean(axis=(1, 2))
                np.testing.assert_allclose(traversal.mu[row, level, i], expected, atol=tolerance)


def test_half_of_the_rows_are_safe(traversal: Traversal) -> None:
    assert np.mean(traversal.g >= 0.05) == pytest.approx(0.5, abs=1e-4)


def test_values_are_in_range_and_grow_with_the_current(traversal: Traversal) -> None:
    assert traversal.mu.shape == (21_800, 10, 6, 2)
    assert traversal.mu.min() >= 0
    assert traversal.mu.max() <= 1
    assert np.all(np.diff(traversal.mu, axis=1) >= 0)
    assert np.abs(traversal.si).max() <= 1
    np.testing.assert_allclose(traversal.g, 1 - traversal.mu.max(axis=(2, 3)), atol=1e-6)


def test_swapping_all_polarities_changes_nothing(
    activating: ActivatingFunction, traversal: Traversal
) -> None:
    """The absolute activating function cannot tell cathodes from anodes."""
    rows = np.flatnonzero((traversal.polarity != 0).sum(axis=1) == 2)
    swapped = traverse(
        activating,
        districts(Anatomy()),
        -traversal.polarity[rows],
        traversal.currents,
        0.05,
        traversal.threshold,
    )
    np.testing.assert_array_equal(swapped.mu, traversal.mu[rows])


def test_two_traversals_are_equal_to_the_bit(activating: ActivatingFunction, traversal: Traversal) -> None:
    again = traverse(activating, districts(Anatomy()), enumerate_configurations(), traversal.currents, 0.05)
    assert again.threshold == traversal.threshold
    np.testing.assert_array_equal(again.mu, traversal.mu)


@pytest.mark.parametrize(("points", "rank"), [(20, 0), (40, 1), (100, 4), (39, 1), (7, 0)])
def test_a_pool_saturates_when_more_than_95_percent_of_it_is_active(points: int, rank: int) -> None:
    values = np.arange(points, dtype=float)
    found = saturating_rank(points, 0.05)
    assert found == rank
    assert np.mean(values > values[rank] - 0.5) > 0.95
    assert not np.mean(values > values[rank]) > 0.95


def test_calibration_splits_the_rows_in_half() -> None:
    rng = np.random.default_rng(2)
    saturation, currents = rng.lognormal(size=301), np.geomspace(0.1, 4.0, 10)
    threshold = calibrate(saturation, currents)
    assert np.mean(np.multiply.outer(saturation, currents) <= threshold) == 0.5


def test_a_dead_model_cannot_be_calibrated() -> None:
    with pytest.raises(DatasetError, match=r"calibrates to 0.0 mV"):
        calibrate(np.zeros(10), np.ones(10))


def test_a_district_without_slices_is_refused(activating: ActivatingFunction) -> None:
    borders = districts(Anatomy()) | {"TA": (60.0, 60.01)}
    with pytest.raises(AnatomyError, match="no sampled slice lies in the district of TA"):
        traverse(activating, borders, enumerate_configurations()[:5], np.ones(1), 0.05)
