"""The cross section of the cord and its coverings: tissues on a conforming triangulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdsafebo.spinal.geometry.anatomy import CONTACT_CENTRES, CONTACT_WIDTH, GREY_OUTLINE, Anatomy
from hdsafebo.spinal.geometry.anatomy_check import check_anatomy
from hdsafebo.spinal.geometry.triangulation import Curve, Size, triangulate

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_DENSE = 2001  # points of the polyline that stands for a smooth curve


@dataclass(frozen=True)
class CrossSection:
    """A triangulated section.

    Attributes:
        nodes: mm, shape (2, nodes).
        triangles: shape (3, triangles), counter-clockwise.
        tissue: index into `tissues` of each triangle, shape (triangles,).
        tissues: names of the tissues.
        boundary: nodes on the outline, where the potential is zero.
        contact_edges: edges of the interface that carries the contacts, shape (edges, 2).
    """

    nodes: Array
    triangles: Index
    tissue: Index
    tissues: tuple[str, ...]
    boundary: Index
    contact_edges: Index

    def in_tissue(self, *names: str) -> NDArray[np.bool_]:
        """Which triangles are of one of the named tissues, shape (triangles,)."""
        return np.isin(self.tissue, [self.tissues.index(n) for n in names])


@dataclass(frozen=True)
class EdgeLengths:
    """Wanted edge lengths in mm: in the cord, at the contacts, the largest; and their growth per mm."""

    cord: float
    contacts: float
    largest: float
    growth: float = 0.3

    def scaled(self, factor: float) -> EdgeLengths:
        """The same distribution with all lengths multiplied: uniform refinement."""
        return EdgeLengths(
            factor * self.cord, factor * self.contacts, factor * self.largest, factor * self.growth
        )


def cord_section(anatomy: Anatomy, lengths: EdgeLengths) -> CrossSection:
    """The reference section, that of the widest segment; `mesh` maps it along the cord.

    Args:
        anatomy: dimensions.
        lengths: wanted edge lengths.

    Raises:
        AnatomyError: the anatomy is impossible, or too tight to be triangulated.
    """
    check_anatomy(anatomy)
    a, b = anatomy.half_width, anatomy.half_depth
    half = _half_turn()
    grey = np.array(GREY_OUTLINE) * [a, b]
    outside = anatomy.dura
    regions = {
        "grey": Curve("grey", grey, tuple(range(len(grey)))),
        "white": _ellipse("white", a, b),
        "csf": Curve("csf", _on_midline(anatomy.sac_outline(half))),
        "dura": Curve("dura", _on_midline(anatomy.sac_outline(half, outside))),
        "paddle": _paddle(anatomy),
        "fat": _ellipse("fat", anatomy.canal_width / 2, anatomy.canal_depth / 2),
        "bone": _ellipse("bone", anatomy.body_radius, anatomy.body_radius),
    }
    reach = float(np.abs(anatomy.contacts()[:, 0]).max()) + CONTACT_WIDTH / 2
    size = graded_size(lengths, (a, b), (reach, anatomy.paddle_face))
    return build_section(regions, size, contacts_on="paddle")


def graded_size(lengths: EdgeLengths, cord: tuple[float, float], contacts: tuple[float, float]) -> Size:
    """Edge lengths that grow with the distance from the cord and from the contacts.

    Args:
        lengths: in the cord, at the contacts, and the largest.
        cord: half width and half depth of the cord, mm.
        contacts: the contacts lie on the line from (-x, y) to (x, y), given as (x, y), mm.
    """
    a, b = cord
    reach, height = contacts

    def size(points: Array) -> Array:
        from_cord = np.maximum(np.hypot(points[:, 0] / a, points[:, 1] / b) - 1, 0) * b
        from_contacts = np.hypot(np.maximum(np.abs(points[:, 0]) - reach, 0), points[:, 1] - height)
        near = np.minimum(
            lengths.cord + lengths.growth * from_cord, lengths.contacts + lengths.growth * from_contacts
        )
        return np.minimum(near, lengths.largest)

    return size


def build_section(regions: dict[str, Curve], size: Size, contacts_on: str) -> CrossSection:
    """Triangulate nested tissues.

    Args:
        regions: tissue -> outline, inner before outer; a triangle is of the first tissue that holds it.
        size: wanted edge lengths in mm at points (n, 2).
        contacts_on: the interface that carries the contacts.
    """
    mesh = triangulate(list(regions.values()), size)
    centroid = mesh.nodes[:, mesh.triangles].mean(axis=1)
    tissue = np.full(mesh.triangles.shape[1], len(regions) - 1)
    for index in reversed(range(len(regions))):
        outline = mesh.nodes[:, mesh.edges[list(regions)[index]]]
        tissue[_enclosed(centroid, outline)] = index
    boundary = np.unique(mesh.edges[list(regions)[-1]])
    return CrossSection(mesh.nodes, mesh.triangles, tissue, tuple(regions), boundary, mesh.edges[contacts_on])


def circle(name: str, radius: float, marks: Sequence[float] = ()) -> Curve:
    """A circle's right half from the dorsal pole; `marks` are arc lengths from it that become vertices."""
    angle = np.unique(np.concatenate([np.linspace(0, np.pi, _DENSE), np.asarray(marks) / radius]))
    points = radius * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    return Curve(name, _on_midline(points), tuple(np.searchsorted(angle, np.asarray(marks) / radius)))


def _half_turn() -> Array:
    return np.linspace(np.pi / 2, -np.pi / 2, _DENSE)


def _ellipse(name: str, half_width: float, half_depth: float) -> Curve:
    angle = _half_turn()
    return Curve(
        name, _on_midline(np.stack([half_width * np.cos(angle), half_depth * np.sin(angle)], axis=1))
    )


def _on_midline(points: Array) -> Array:
    """The same points with both ends exactly at x = 0."""
    points = points.copy()
    points[[0, -1], 0] = 0.0
    return points


def _paddle(anatomy: Anatomy) -> Curve:
    """Half of the paddle's outline, with the contacts' borders as corners."""
    face, back = anatomy.paddle_face, anatomy.paddle_face + anatomy.paddle_thickness
    edge = anatomy.paddle_width / 2
    borders = [abs(c - edge) + s * CONTACT_WIDTH / 2 for c in CONTACT_CENTRES for s in (-1, 1)]
    below = [(x, face) for x in sorted({0.0, edge, *borders})]
    points = np.array([*below, (edge, back), (0.0, back)])
    return Curve("paddle", points, tuple(range(len(points))))


def _enclosed(points: Array, outline: Array) -> NDArray[np.bool_]:
    """Which points (2, n) lie inside the closed outline of edges (2, m, 2): ray casting."""
    x, y = points
    inside = np.zeros(x.shape, dtype=bool)
    for (xa, xb), (ya, yb) in zip(*outline, strict=True):
        crosses = (ya > y) != (yb > y)
        if crosses.any():
            inside ^= crosses & (x < xa + (y - ya) / (yb - ya if yb != ya else 1.0) * (xb - xa))
    return inside
