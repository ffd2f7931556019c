"""The cord's section and its extrusion: tissues in their place, volumes as they should be."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.errors import AnatomyError
from hdsafebo.spinal.geometry.anatomy import GREY_OUTLINE, Anatomy
from hdsafebo.spinal.geometry.mesh import PrismMesh, cord_map, extrude, graded_axis
from hdsafebo.spinal.geometry.section import CrossSection, EdgeLengths, cord_section


@pytest.fixture(scope="module")
def section() -> CrossSection:
    return cord_section(Anatomy(), EdgeLengths(0.6, 0.3, 4.0))


def tissue_area(section: CrossSection, name: str) -> float:
    triangles = section.triangles[:, section.in_tissue(name)]
    (xa, xb, xc), (ya, yb, yc) = (c[triangles] for c in section.nodes)
    return float(((xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)).sum() / 2)


def test_tissue_areas_are_those_of_the_outlines(section: CrossSection) -> None:
    anatomy = Anatomy()
    a, b = anatomy.half_width, anatomy.half_depth
    x, y = np.array(GREY_OUTLINE).T * [[a], [b]]
    grey = abs(np.dot(x, np.roll(y, -1)) - np.dot(np.roll(x, -1), y))  # twice the half
    assert tissue_area(section, "grey") == pytest.approx(grey, rel=1e-9)
    assert tissue_area(section, "white") == pytest.approx(np.pi * a * b - grey, rel=0.02)
    assert tissue_area(section, "paddle") == pytest.approx(
        anatomy.paddle_width * anatomy.paddle_thickness, rel=1e-9
    )
    canal = sum(tissue_area(section, n) for n in section.tissues if n != "bone")
    assert canal == pytest.approx(np.pi * anatomy.canal_width * anatomy.canal_depth / 4, rel=0.02)


def test_cord_has_the_width_and_depth_of_the_table() -> None:
    anatomy = Anatomy()
    middle = (anatomy.borders[1:] + anatomy.borders[:-1]) / 2
    place = cord_map(anatomy)
    right, _ = place(np.full(8, anatomy.half_width), np.zeros(8), middle)
    _, top = place(np.zeros(8), np.full(8, anatomy.half_depth), middle)
    np.testing.assert_allclose(2 * right, [s.width for s in anatomy.segments])
    np.testing.assert_allclose(2 * top, [s.depth for s in anatomy.segments])


def test_sac_and_contacts_do_not_move(coarse_mesh: PrismMesh) -> None:
    section = coarse_mesh.section
    outer = np.unique(section.triangles[:, section.in_tissue("dura", "fat", "paddle", "bone")])
    assert np.ptp(coarse_mesh.x[:, outer], axis=0).max() == 0
    assert np.ptp(coarse_mesh.y[:, outer], axis=0).max() == 0


def test_fibres_tilt_only_where_the_cord_tapers(coarse_mesh: PrismMesh) -> None:
    direction = coarse_mesh.fibre_directions()
    np.testing.assert_allclose(np.linalg.norm(direction, axis=0), 1.0)
    middle = (coarse_mesh.z[1:] + coarse_mesh.z[:-1]) / 2
    tilt = np.degrees(np.arccos(direction[2]))
    assert tilt[middle < 0].max() < 0.1
    assert 1.0 < tilt[(middle > 75) & (middle < 100)].max() < 20.0


def test_graded_axis_is_uniform_inside_and_grows_outside() -> None:
    z = graded_axis(-40.0, 10.0, 20.0, 60.0, 0.5)
    assert (z[0], z[-1]) == (-40.0, 60.0)
    step = np.diff(z)
    inside = (z[:-1] >= 10 - 1e-9) & (z[1:] <= 20 + 1e-9)
    np.testing.assert_allclose(step[inside], 0.5)
    assert step.max() <= 8.0
    assert (step > 0).all()


def test_a_folding_map_is_refused(section: CrossSection) -> None:
    with pytest.raises(AnatomyError, match="folds over between z = 1 and 1 mm"):
        extrude(section, np.array([0.0, 1.0]), lambda x, y, z: (x * (1 - 2 * z), y + 0 * z))


def test_interfaces_too_tight_for_a_mesh_are_refused() -> None:
    with pytest.raises(AnatomyError, match=r"interfaces|misses"):
        cord_section(Anatomy().overridden({"dura": 1e-4}), EdgeLengths(1.0, 0.5, 6.0))
