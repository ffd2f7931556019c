"""Conforming Delaunay triangulation of a left-right symmetric section, in numpy and scipy only.

The right half is triangulated and mirrored. Interfaces are resolved by polylines; a polyline's edge is in
the Delaunay triangulation when no other vertex lies in the circle over it, so edges are split until none of
the interfaces' vertices does (Ruppert 1995, J Algorithms 18:548), and free vertices are kept out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree

from hdsafebo.errors import AnatomyError

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Size = Callable[[Array], Array]

_SMOOTHING_ROUNDS = 15
_SPLITTING_ROUNDS = 12
_CLEARANCE = 0.7  # least distance of a free vertex from any other, relative to the local size
_GROWTH = 1.25  # between the lattices that fill the section
_TINY = 1e-9


@dataclass(frozen=True)
class Curve:
    """The part of an interface with x >= 0.

    Attributes:
        name: of the interface.
        points: a polyline dense enough to be taken for the curve, mm, shape (n, 2).
        corners: indices of the points that must become vertices; the ends always do.
    """

    name: str
    points: Array
    corners: tuple[int, ...] = ()


@dataclass(frozen=True)
class Triangulation:
    """A conforming triangulation, symmetric in x.

    Attributes:
        nodes: mm, shape (2, nodes).
        triangles: node numbers, shape (3, triangles).
        edges: node numbers of each interface's edges, name -> (edges, 2).
    """

    nodes: Array
    triangles: Index
    edges: dict[str, Index]


def triangulate(curves: Sequence[Curve], size: Size) -> Triangulation:
    """Triangulate the convex section that the last curve encloses.

    Args:
        curves: the interfaces; they may meet on the midline only. The last one is the convex outline.
        size: wanted edge lengths in mm at points (n, 2).

    Raises:
        AnatomyError: the interfaces cross or nearly touch, so that no such triangulation is found.
    """
    vertices, edges, owner = _resolve(curves, size)
    vertices, edges, owner = _split_encroached(vertices, edges, owner)
    free = _fill(vertices, edges, size, outline=vertices[np.unique(edges[owner == len(curves) - 1])])
    points, triangles = _smooth(vertices, edges, free)
    _require_edges(edges, triangles, [*(c.name for c in curves), "midline"], owner)
    return _mirror(points, triangles, {c.name: edges[owner == i] for i, c in enumerate(curves)})


def _resolve(curves: Sequence[Curve], size: Size) -> tuple[Array, Index, Index]:
    """Vertices (n, 2), edges (m, 2) and the curve that owns each edge; the midline is the last owner."""
    chains = [_resample(c, size) for c in curves]
    middle = np.unique(np.concatenate([chain[chain[:, 0] == 0.0, 1] for chain in chains]).round(9))
    chains.append(
        _resample(Curve("midline", np.stack([0 * middle, middle], axis=1), tuple(range(len(middle)))), size)
    )
    points = np.concatenate(chains).round(9)
    vertices, number = np.unique(points, axis=0, return_inverse=True)
    numbers = np.split(number.ravel(), np.cumsum([len(c) for c in chains])[:-1])
    edges = np.concatenate([np.stack([n[:-1], n[1:]], axis=1) for n in numbers])
    owner = np.repeat(np.arange(len(chains)), [len(n) - 1 for n in numbers])
    return vertices, edges, owner


def _resample(curve: Curve, size: Size) -> Array:
    """Points along a curve whose distances follow the size; corners are kept."""
    corners = sorted({0, *curve.corners, len(curve.points) - 1})
    pieces = [curve.points[:1]]
    for first, last in pairwise(corners):
        piece = curve.points[first : last + 1]
        length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(piece, axis=0).T))])
        fine = np.linspace(0, length[-1], max(2, int(length[-1] / size(piece).min() * 20)))
        at = np.stack([np.interp(fine, length, piece[:, i]) for i in (0, 1)], axis=1)
        density = 1 / size(at)
        count = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(fine))])
        wanted = np.linspace(0, count[-1], max(1, int(np.ceil(count[-1]))) + 1)[1:-1]
        along = np.interp(wanted, count, fine)
        inner = np.stack([np.interp(along, length, piece[:, i]) for i in (0, 1)], axis=1)
        pieces += [inner, piece[-1:]]
    return np.concatenate(pieces)


def _split_encroached(vertices: Array, edges: Index, owner: Index) -> tuple[Array, Index, Index]:
    """Halve the edges whose circle holds another vertex, until there are none."""
    for _ in range(_SPLITTING_ROUNDS):
        ends = vertices[edges]
        centre, radius = ends.mean(axis=1), np.hypot(*(ends[:, 1] - ends[:, 0]).T) / 2
        inside = cKDTree(vertices).query_ball_point(centre, radius * (1 - _TINY), return_length=True)
        bad = inside > 0
        if not bad.any():
            return vertices, edges, owner
        new = np.arange(len(vertices), len(vertices) + bad.sum())
        vertices = np.concatenate([vertices, centre[bad]])
        halves = [np.stack([edges[bad, 0], new], axis=1), np.stack([new, edges[bad, 1]], axis=1)]
        edges = np.concatenate([edges[~bad], *halves])
        owner = np.concatenate([owner[~bad], owner[bad], owner[bad]])
    raise AnatomyError("two interfaces of the section touch or cross: they cannot be resolved by a mesh")


def _fill(vertices: Array, edges: Index, size: Size, outline: Array) -> Array:
    """Free vertices inside the outline: hexagonal lattices, each where its spacing is wanted."""
    reach = np.abs(outline).max()
    sample = np.stack(
        np.meshgrid(np.linspace(0, reach, 200), np.linspace(-reach, reach, 400)), axis=-1
    ).reshape(-1, 2)
    wanted = size(sample)
    spacing, candidates = float(wanted.min()), []
    while spacing <= wanted.max() * _GROWTH:
        x = np.arange(spacing / 2, reach, spacing)
        y = np.arange(-reach, reach, spacing * np.sqrt(3) / 2)
        grid = np.stack(np.meshgrid(x, y), axis=-1)
        grid[1::2, :, 0] += spacing / 2
        lattice = grid.reshape(-1, 2)
        local = size(lattice)
        candidates.append(lattice[(local >= spacing) & (local < spacing * _GROWTH)])
        spacing *= _GROWTH
    points = np.concatenate(candidates)
    hull = Delaunay(outline)
    points = points[(hull.find_simplex(points) >= 0) & ~_encroaches(points, vertices, edges)]
    points = points[cKDTree(vertices).query(points)[0] > _CLEARANCE * size(points)]
    return points[_spread(points, _CLEARANCE * size(points))]


def _spread(points: Array, distance: Array) -> NDArray[np.bool_]:
    """Greedy choice of points that are further apart than `distance`; earlier points win."""
    keep = np.ones(len(points), dtype=bool)
    for i, near in enumerate(cKDTree(points).query_ball_point(points, distance)):
        if keep[i]:
            keep[[j for j in near if j > i]] = False
    return keep


def _encroaches(points: Array, vertices: Array, edges: Index) -> NDArray[np.bool_]:
    """Whether each point lies in the circle over an edge."""
    ends = vertices[edges]
    centre, radius = ends.mean(axis=1), np.hypot(*(ends[:, 1] - ends[:, 0]).T) / 2
    bad = np.zeros(len(points), dtype=bool)
    for near in cKDTree(points).query_ball_point(centre, radius * (1 + 1e-6)):
        bad[near] = True
    return bad


def _smooth(vertices: Array, edges: Index, free: Array) -> tuple[Array, Index]:
    """Move free vertices to the mean of their neighbours, unless that breaks an interface."""
    points, fixed = np.concatenate([vertices, free]), len(vertices)
    for _ in range(_SMOOTHING_ROUNDS):
        start, neighbours = Delaunay(points).vertex_neighbor_vertices
        total = np.add.reduceat(points[neighbours], start[:-1], axis=0)
        moved = (total / np.diff(start)[:, None])[fixed:]
        good = ~_encroaches(moved, vertices, edges)
        points[fixed:][good] = moved[good]
    triangles = Delaunay(points).simplices.astype(np.intp)
    first, second = (
        points[triangles[:, 1]] - points[triangles[:, 0]],
        points[triangles[:, 2]] - points[triangles[:, 0]],
    )
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    triangles[area < 0] = triangles[area < 0][:, [0, 2, 1]]
    return points, triangles[np.abs(area) > _TINY]


def _require_edges(edges: Index, triangles: Index, names: Sequence[str], owner: Index) -> None:
    """Raise AnatomyError unless every interface's edge is an edge of the triangulation."""
    have = {
        (min(a, b), max(a, b))
        for t in triangles.tolist()
        for a, b in ((t[0], t[1]), (t[1], t[2]), (t[2], t[0]))
    }
    missing = [i for i, (a, b) in enumerate(edges.tolist()) if (min(a, b), max(a, b)) not in have]
    if missing:
        where = sorted({names[owner[i]] for i in missing})
        raise AnatomyError(f"the triangulation misses {len(missing)} edges of {', '.join(where)}")


def _mirror(points: Array, triangles: Index, edges: dict[str, Index]) -> Triangulation:
    """The whole section from its right half."""
    off = np.flatnonzero(points[:, 0] > 0)
    image = np.arange(len(points))
    image[off] = len(points) + np.arange(len(off))
    nodes = np.concatenate([points, points[off] * [-1, 1]]).T
    whole = np.concatenate([triangles, image[triangles][:, [0, 2, 1]]]).T
    both = {name: np.concatenate([e, image[e]]) for name, e in edges.items()}
    return Triangulation(np.ascontiguousarray(nodes), np.ascontiguousarray(whole), both)
