"""Field maps against their definition, pixel by pixel."""

import numpy as np
import pytest

from hdsafebo.errors import DatasetError
from hdsafebo.spinal.configurations import enumerate_configurations
from hdsafebo.spinal.field_map import (
    COLUMNS,
    PIXELS,
    ROWS,
    RandomCurrents,
    contact_pixels,
    field_maps,
    unit_potentials,
)


def pixelwise_potential(polarity: np.ndarray, pixel: int) -> float:
    """The definition, read literally, for one pixel."""
    pixels = contact_pixels()
    cathode, anode = pixels[polarity < 0].ravel(), pixels[polarity > 0].ravel()
    if pixel in cathode:
        return -1.0
    if pixel in anode:
        return 0.0
    here = divmod(pixel, COLUMNS)
    inverse = [
        [
            1 / np.hypot(here[0] - row, here[1] - column)
            for row, column in (divmod(int(p), COLUMNS) for p in group)
        ]
        for group in (cathode, anode)
    ]
    mean, total = np.mean(inverse[0]), np.sum(inverse[1])
    return float(-0.2 * mean / (total + mean))


def test_contacts_lie_where_the_paddle_has_them() -> None:
    pixels = contact_pixels()
    rows, columns = np.divmod(pixels, COLUMNS)
    assert (rows[:8, 0] + 1).tolist() == [6, 12, 18, 24, 30, 36, 42, 48]
    assert (rows[8:, 0] + 1).tolist() == [3, 9, 15, 21, 27, 33, 39, 45]
    assert (columns[:8] == 2).all()
    assert (columns[8:] == 5).all()
    assert (np.diff(rows, axis=1) == 1).all()
    assert rows.max() < ROWS
    assert len(np.unique(pixels)) == 16 * 3


@pytest.mark.parametrize("index", [0, 15, 5000, 9199, 9200, 21799])
def test_unit_potential_is_the_definition(index: int) -> None:
    polarity = enumerate_configurations()[index]
    expected = [pixelwise_potential(polarity, pixel) for pixel in range(PIXELS)]
    np.testing.assert_allclose(unit_potentials(polarity[None])[0], expected, atol=1e-15)


def test_all_maps_differ_and_stay_in_range() -> None:
    unit = unit_potentials(enumerate_configurations())
    assert unit.shape == (21_800, 728)
    assert unit.min() == -1.0
    assert unit.max() == 0.0
    assert len(np.unique(unit.round(12), axis=0)) == 21_800


def test_map_is_affine_in_the_current() -> None:
    unit = unit_potentials(enumerate_configurations()[:3])
    maps = field_maps(unit, np.array([0.5, 2.5, 5.0]))
    np.testing.assert_allclose(maps, 1 + np.array([[0.1], [0.5], [1.0]]) * unit)
    np.testing.assert_allclose(field_maps(unit, 5.0), 1 + unit)


def test_random_currents_rescales_each_map_by_one_of_the_currents() -> None:
    unit = unit_potentials(enumerate_configurations()[:500])
    source = RandomCurrents((0.5, 1.0, 4.0))
    drawn = source(field_maps(unit, 5.0), np.random.default_rng(0))
    share = (drawn - 1).sum(axis=1) / unit.sum(axis=1)
    np.testing.assert_allclose(drawn, 1 + share[:, None] * unit)
    assert set(share.round(9)) == {0.1, 0.2, 0.8}
    np.testing.assert_array_equal(drawn, source(field_maps(unit, 5.0), np.random.default_rng(0)))


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (np.zeros((2, 15)), r"shape \(2, 15\)"),
        (np.full((1, 16), 2), "polarity is 2"),
        (np.full((1, 16), np.nan), "polarity is"),
        (np.eye(16), "no cathode"),
        (-np.eye(16), "no anode"),
    ],
)
def test_bad_configurations_are_refused(bad: np.ndarray, message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        unit_potentials(bad)
