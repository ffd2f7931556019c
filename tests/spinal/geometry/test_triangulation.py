"""Triangulations conform to every interface, are symmetric, and cover the section once."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.errors import AnatomyError
from hdsafebo.spinal.geometry.section import EdgeLengths, circle, graded_size
from hdsafebo.spinal.geometry.triangulation import Curve, Triangulation, triangulate

LENGTHS = EdgeLengths(0.6, 0.3, 2.0)


@pytest.fixture(scope="module")
def rings() -> Triangulation:
    size = graded_size(LENGTHS, (3.0, 3.0), (0.5, 5.0))
    return triangulate([circle("inner", 3.0), circle("source", 5.0, [0.5]), circle("outline", 9.0)], size)


def areas(mesh: Triangulation) -> np.ndarray:
    (xa, xb, xc), (ya, yb, yc) = (c[mesh.triangles] for c in mesh.nodes)
    return ((xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)) / 2


def test_triangles_are_positive_and_cover_the_disc(rings: Triangulation) -> None:
    outline = rings.nodes[:, rings.edges["outline"]]
    polygon = np.abs(outline[0, :, 0] * outline[1, :, 1] - outline[0, :, 1] * outline[1, :, 0]).sum() / 2
    assert areas(rings).min() > 0
    assert areas(rings).sum() == pytest.approx(polygon, rel=1e-12)


def test_every_interface_edge_is_an_edge_of_the_mesh(rings: Triangulation) -> None:
    t = rings.triangles
    have = {frozenset(e) for pair in ((0, 1), (1, 2), (2, 0)) for e in t[list(pair)].T.tolist()}
    for edges in rings.edges.values():
        assert all(frozenset(e) in have for e in edges.tolist())


def test_interface_vertices_lie_on_their_circles(rings: Triangulation) -> None:
    for name, radius in (("inner", 3.0), ("source", 5.0), ("outline", 9.0)):
        r = np.hypot(*rings.nodes[:, np.unique(rings.edges[name])])
        np.testing.assert_allclose(r, radius, atol=1e-5)
    arc = 5.0 * np.arctan2(*rings.nodes[:, np.unique(rings.edges["source"])])
    assert np.abs(arc - 0.5).min() < 1e-6, "the mark is no vertex"


def test_mesh_is_symmetric(rings: Triangulation) -> None:
    x, y = rings.nodes
    points = {(round(a, 9), round(b, 9)) for a, b in zip(x, y, strict=True)}
    assert {(round(-a, 9) + 0.0, b) for a, b in points} == {(a + 0.0, b) for a, b in points}


def test_triangles_are_well_shaped_and_of_the_wanted_size(rings: Triangulation) -> None:
    corners = rings.nodes[:, rings.triangles]
    sides = np.stack([np.hypot(*(corners[:, i] - corners[:, j])) for i, j in ((0, 1), (1, 2), (2, 0))])
    quality = 4 * np.sqrt(3) * areas(rings) / (sides**2).sum(axis=0)
    assert np.median(quality) > 0.9
    inside = np.hypot(*corners.mean(axis=1)) < 2.5
    assert 0.7 * LENGTHS.cord < sides[:, inside].mean() < 1.3 * LENGTHS.cord


def test_crossing_interfaces_are_refused() -> None:
    t = np.linspace(0, np.pi, 200)
    shifted = Curve("shifted", np.stack([3 * np.sin(t), 3 * np.cos(t) + 1.0], axis=1) * [1.0, 1.0])
    shifted.points[[0, -1], 0] = 0.0
    with pytest.raises(AnatomyError, match="interfaces"):
        triangulate(
            [circle("inner", 3.0), shifted, circle("outline", 9.0)],
            graded_size(LENGTHS, (3.0, 3.0), (0.5, 5.0)),
        )
