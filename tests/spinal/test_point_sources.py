"""Responses of axons to point sources: a formula, consequences of superposition, and where they peak."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.spinal import point_sources
from hdsafebo.spinal.configurations import enumerate_configurations
from hdsafebo.spinal.point_sources import DEPTHS_MM, LINES_MM, STRETCHES, unit_responses


def polarities(*contacts: dict[int, int]) -> np.ndarray:
    polarity = np.zeros((len(contacts), 16), dtype=np.int8)
    for row, given in zip(polarity, contacts, strict=True):
        row[list(given)] = list(given.values())
    return polarity


def test_the_second_derivative_is_that_of_the_potential() -> None:
    z, step = np.array([3.0, 10.0, 25.0]), 1e-3
    row, column = np.arange(6, 49, 6)[0] + 0.5, 2.5  # centre of contact 1, pixels 6 to 8 of column 3
    r = [np.sqrt((z + k * step - row) ** 2 + (7.0 - column) ** 2 + 4.0**2) for k in (-1, 0, 1)]
    by_differences = (1 / r[0] - 2 / r[1] + 1 / r[2]) / step**2
    np.testing.assert_allclose(point_sources._second_derivative(7.0, 4.0, z)[0], by_differences, rtol=1e-4)


def test_exchanging_cathodes_and_anodes_changes_nothing() -> None:
    polarity = enumerate_configurations()[::4000]
    np.testing.assert_allclose(unit_responses(polarity), unit_responses(-polarity))


def test_a_pole_divides_its_current() -> None:
    shared, single, other = unit_responses(polarities({0: -1, 5: 1, 6: 1}, {0: -1, 5: 1}, {0: -1, 6: 1}))
    assert (shared <= (single + other) / 2 + 1e-15).all()  # the norm of a mean of two activating functions


@pytest.mark.parametrize(("contacts", "stretches"), [((0, 1), range(1, 5)), ((6, 7), range(9, 14))])
def test_responses_are_strongest_beside_the_contacts(contacts: tuple[int, int], stretches: range) -> None:
    response = unit_responses(polarities({contacts[0]: -1, contacts[1]: 1}))
    cube = response.reshape(len(DEPTHS_MM), len(LINES_MM), STRETCHES)
    depth, line, stretch = np.unravel_index(cube.argmax(), cube.shape)
    assert (depth, line) == (0, 0)  # the shallower line nearest to the left column of contacts
    assert stretch in stretches
    assert (cube[1].max(axis=1) < cube[0].max(axis=1)).all()
