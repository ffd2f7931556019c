"""Finite-element matrices against integrals that are known."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.errors import AnatomyError, UnknownNameError
from hdsafebo.spinal.finite_elements.assembly import Contact, contact_currents, stiffness
from hdsafebo.spinal.finite_elements.solution import cord_contacts
from hdsafebo.spinal.geometry.anatomy import Anatomy
from hdsafebo.spinal.geometry.conductivity import Conductivity, conductivity_table, cord_conductivity
from hdsafebo.spinal.geometry.mesh import PrismMesh, extrude
from hdsafebo.spinal.geometry.section import EdgeLengths, build_section, circle, graded_size

RADIUS, HEIGHT = 5.0, 7.0


@pytest.fixture(scope="module")
def twisted() -> PrismMesh:
    """A cylinder whose columns wind around its axis and whose slices are uneven."""
    size = graded_size(EdgeLengths(0.8, 0.8, 0.8), (3.0, 3.0), (0.5, 3.0))
    section = build_section({"core": circle("core", 3.0), "rim": circle("rim", RADIUS)}, size, "core")
    z = np.array([0.0, 0.3, 1.1, 2.0, 3.5, 5.0, 5.2, HEIGHT])

    def twist(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        angle = 0.05 * z * np.cos(np.pi * np.hypot(x, y) / 2 / RADIUS)
        return x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)

    return extrude(section, z, twist)


def uniform(mesh: PrismMesh, across: float, along: float, direction: np.ndarray) -> Conductivity:
    shape = (len(mesh.z) - 1, mesh.section.triangles.shape[1])
    unit = direction / np.linalg.norm(direction)
    return Conductivity(
        np.full(shape, across), np.full(shape, along), np.broadcast_to(unit[:, None, None], (3, *shape))
    )


def test_linear_potentials_dissipate_what_the_tensor_says(twisted: PrismMesh) -> None:
    direction = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    across, along = 0.2, 0.7
    matrix = stiffness(twisted, uniform(twisted, across, along, direction))
    outline = twisted.section.nodes[:, twisted.section.boundary]
    order = np.argsort(np.arctan2(*outline))
    x, y = outline[:, order]
    volume = abs(np.dot(x, np.roll(y, -1)) - np.dot(np.roll(x, -1), y)) / 2 * HEIGHT
    nodes = np.stack([twisted.x.ravel(), twisted.y.ravel(), np.repeat(twisted.z, twisted.x.shape[1])])
    tensor = across * np.eye(3) + (along - across) * np.outer(direction, direction)
    for gradient in np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [1, -2, 0.5]]):
        potential = gradient @ nodes
        expected = volume * gradient @ tensor @ gradient
        # the 2 x 3 Gauss points are not exact on twisted prisms, whose Jacobian is rational
        assert potential @ (matrix @ potential) == pytest.approx(expected, rel=2e-3)


def test_stiffness_is_symmetric_and_blind_to_constants(twisted: PrismMesh) -> None:
    matrix = stiffness(twisted, uniform(twisted, 0.083, 0.6, np.array([0.0, 0.0, 1.0])))
    assert abs(matrix - matrix.T).max() < 1e-14
    assert np.abs(matrix @ np.ones(matrix.shape[0])).max() < 1e-13


def test_each_contact_carries_one_milliampere_at_its_centre(coarse_mesh: PrismMesh) -> None:
    loads = contact_currents(coarse_mesh, cord_contacts(Anatomy(), coarse_mesh))
    nodes = np.stack(
        [coarse_mesh.x.ravel(), coarse_mesh.y.ravel(), np.repeat(coarse_mesh.z, coarse_mesh.x.shape[1])]
    )
    np.testing.assert_allclose(loads.sum(axis=0), 1.0, rtol=1e-12)
    assert loads.min() >= 0
    x, y, z = nodes @ loads
    np.testing.assert_allclose(np.stack([x, z], axis=1), Anatomy().contacts(), atol=1e-9)
    np.testing.assert_allclose(y, Anatomy().paddle_face, atol=1e-9)


@pytest.mark.parametrize(
    "contact", [Contact(np.zeros((0, 2), dtype=np.intp), 1.0, 2.0), Contact(np.array([[0, 1]]), 500.0, 503.0)]
)
def test_a_contact_off_the_mesh_is_refused(coarse_mesh: PrismMesh, contact: Contact) -> None:
    with pytest.raises(AnatomyError, match="contact 1 covers no part"):
        contact_currents(coarse_mesh, [contact])


def test_tissues_have_their_conductivities_and_fat_replaces_the_paddle_beyond_its_ends(
    coarse_mesh: PrismMesh,
) -> None:
    anatomy = Anatomy()
    found = cord_conductivity(anatomy, coarse_mesh, conductivity_table({"fat": 0.05, "white_along": 0.7}))
    section = coarse_mesh.section
    assert np.all(found.along[:, section.in_tissue("white")] == 0.7)
    assert np.all(found.across[:, section.in_tissue("white")] == 0.083)
    paddle = found.across[:, section.in_tissue("paddle")]
    middle = (coarse_mesh.z[1:] + coarse_mesh.z[:-1]) / 2
    inside = (middle > anatomy.paddle_rostral_edge) & (
        middle < anatomy.paddle_rostral_edge + anatomy.paddle_length
    )
    assert np.all(paddle[inside] == 0.002)
    assert np.all(paddle[~inside] == 0.05)


def test_unknown_tissues_and_senseless_conductivities_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="unknown tissue 'blood'"):
        conductivity_table({"blood": 0.7})
    with pytest.raises(AnatomyError, match="conductivity of csf is -1"):
        conductivity_table({"csf": -1.0})
