"""The production solver against exact solutions: layered cylinder, bent columns, free space."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.spinal.activating_function import potential_on_fibres
from hdsafebo.spinal.finite_elements.reference_cylinder import LayeredCylinder
from hdsafebo.spinal.geometry.section import EdgeLengths
from hdsafebo.spinal.verification import Errors, cylinder_errors, cylinder_field

CYLINDER = LayeredCylinder()
BASE = EdgeLengths(1.0, 0.5, 4.0, growth=0.6)
STANDARD = EdgeLengths(0.4, 0.2, 4.0)


@pytest.fixture(scope="module")
def coarse() -> Errors:
    return cylinder_errors(CYLINDER, BASE, 1.0)


@pytest.fixture(scope="module")
def finer() -> Errors:
    return cylinder_errors(CYLINDER, BASE.scaled(0.6), 0.6)


def test_potential_converges_with_second_order(coarse: Errors, finer: Errors) -> None:
    order = np.log(coarse.potential / finer.potential) / np.log(1 / 0.6)
    assert finer.unknowns < 70_000
    assert finer.potential.max() < 0.006
    assert order.mean() > 1.5


def test_activating_function_is_close_to_the_exact_one(finer: Errors) -> None:
    assert np.all(finer.activating < [0.01, 0.03, 0.06])


def test_bent_columns_are_as_good(finer: Errors) -> None:
    bent = cylinder_errors(CYLINDER, BASE.scaled(0.6), 0.6, bulge=0.4)
    assert np.all(bent.potential < 1.3 * finer.potential.max())
    assert np.all(bent.activating < [0.03, 0.03, 0.06])
    assert bent.solution.reciprocity_error < 1e-6
    assert bent.solution.current_error < 1e-6


def test_preconditioner_is_exact_on_straight_columns(finer: Errors) -> None:
    assert finer.solution.iterations == 1


def test_homogeneous_medium_against_its_closed_form() -> None:
    """No interfaces: errors are those of source and boundary alone."""
    uniform = LayeredCylinder(across=(0.3,) * 4, along=(0.3,) * 4)
    errors = cylinder_errors(uniform, BASE.scaled(0.6), 0.6)
    assert errors.potential.max() < 0.01
    assert errors.activating.max() < 0.03


def test_two_patches_see_each_other_alike() -> None:
    field, solution = cylinder_field(CYLINDER, BASE, 1.0)
    assert solution.reciprocity_error < 1e-6
    values = potential_on_fibres(field, np.array([[0.0, 2.0]]))[:, 0]
    peaks = field.z[np.argmax(values, axis=0)]
    assert np.abs(peaks - field.contacts[:, 1]).max() <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("bulge", [0.0, 0.4])
def test_standard_mesh_meets_its_accuracy(bulge: float) -> None:
    errors = cylinder_errors(CYLINDER, STANDARD, 0.5, bulge)
    assert errors.unknowns <= 300_000
    assert errors.potential.max() <= 0.005
    assert errors.activating.max() <= 0.015
