"""A coarse cord, solved once for all tests of the spinal model."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.spinal.activating_function import ActivatingFunction, sample
from hdsafebo.spinal.configurations import enumerate_configurations
from hdsafebo.spinal.finite_elements.solution import Solution, as_lead_field, cord_contacts, solve
from hdsafebo.spinal.geometry.anatomy import Anatomy
from hdsafebo.spinal.geometry.conductivity import conductivity_table, cord_conductivity
from hdsafebo.spinal.geometry.mesh import PrismMesh, cord_mesh
from hdsafebo.spinal.geometry.section import EdgeLengths, cord_section
from hdsafebo.spinal.lead_field import LeadField
from hdsafebo.spinal.muscles import districts
from hdsafebo.spinal.traversal import Traversal, traverse

COARSE, STEP = EdgeLengths(1.0, 0.5, 6.0), 1.2  # mm
CURRENTS = np.geomspace(0.05, 5.0, 10)


@pytest.fixture(scope="session")
def coarse_mesh() -> PrismMesh:
    return cord_mesh(Anatomy(), cord_section(Anatomy(), COARSE), STEP)


@pytest.fixture(scope="session")
def coarse_solution(coarse_mesh: PrismMesh) -> Solution:
    conductivity = cord_conductivity(Anatomy(), coarse_mesh, conductivity_table({}))
    return solve(coarse_mesh, conductivity, cord_contacts(Anatomy(), coarse_mesh))


@pytest.fixture(scope="session")
def coarse_field(coarse_mesh: PrismMesh, coarse_solution: Solution) -> LeadField:
    return as_lead_field(coarse_mesh, Anatomy(), coarse_solution)


@pytest.fixture(scope="session")
def activating(coarse_field: LeadField) -> ActivatingFunction:
    return sample(coarse_field, 18.0, 90.0, spacing=0.9, slices=48)


@pytest.fixture(scope="session")
def traversal(activating: ActivatingFunction) -> Traversal:
    return traverse(activating, districts(Anatomy()), enumerate_configurations(), CURRENTS, 0.05)
