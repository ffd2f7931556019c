"""Lead fields of the cord: reciprocity, conservation, and files that are what they claim."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import diags

from hdsafebo.spinal.finite_elements.solution import Solution
from hdsafebo.spinal.finite_elements.solver import conjugate_gradients
from hdsafebo.spinal.lead_field import LeadField, LeadFieldError


def test_reciprocity(coarse_solution: Solution) -> None:
    assert coarse_solution.reciprocity_error <= 1e-6


def test_current_leaving_is_current_injected(coarse_solution: Solution) -> None:
    assert coarse_solution.outflow.shape == (16,)
    assert coarse_solution.current_error <= 1e-6


def test_a_contact_feels_itself_most_and_near_ones_more_than_far_ones(coarse_solution: Solution) -> None:
    resistance = coarse_solution.resistance
    assert np.all(np.argmax(resistance, axis=1) == np.arange(16))
    lateral = resistance[0, :8]
    assert np.all(np.diff(lateral) < 0)
    assert resistance.min() > 0


def test_medial_contacts_reach_the_left_cord_more_than_the_right(coarse_field: LeadField) -> None:
    section = np.abs(coarse_field.z - 55.5).argmin()
    x, y = coarse_field.section_nodes
    left, right = (np.argmin(np.hypot(x - s * 3.0, y - 1.0)) for s in (-1, 1))
    assert coarse_field.potential[section, left, 12] > coarse_field.potential[section, right, 12]


def test_conjugate_gradients_solve_and_say_when_they_cannot() -> None:
    rng = np.random.default_rng(3)
    matrix = diags([np.linspace(1, 50, 80), np.full(79, 0.3), np.full(79, 0.3)], [0, 1, -1]).tocsr()
    loads = rng.normal(size=(80, 3))
    found, iterations = conjugate_gradients(matrix, loads, lambda r: r, 1e-10, "test")
    np.testing.assert_allclose(matrix @ found, loads, atol=1e-8)
    assert iterations < 80
    stiff = diags([np.geomspace(1, 1e12, 3000)], [0]).tocsr()
    with pytest.raises(
        LeadFieldError, match=r"relative residual of .* after 200 iterations, expected 1.0e-10"
    ):
        conjugate_gradients(stiff, rng.normal(size=(3000, 2)), lambda r: r, 1e-10, "test")
    broken = matrix.copy()
    broken.data[5] = np.nan
    with pytest.raises(LeadFieldError, match="not finite after 1 iterations"):
        conjugate_gradients(broken, loads, lambda r: r, 1e-10, "test")
