"""Prisms: a reference section, extruded along a graded axis and mapped slice by slice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from hdsafebo.errors import AnatomyError
from hdsafebo.spinal.geometry.anatomy import CONUS, Anatomy
from hdsafebo.spinal.geometry.section import CrossSection

Array = NDArray[np.float64]
SliceMap = Callable[[Array, Array, Array], tuple[Array, Array]]

_AXIS_GROWTH = 1.25  # ratio of neighbouring steps beyond the core
_LARGEST_STEP = 5.0  # mm
_CORE_MARGIN = 2.0  # mm of fine steps beyond cord and paddle
_BLENDING = 0.85  # share of the way from cord to sac over which the cord's scaling fades out


@dataclass(frozen=True)
class PrismMesh:
    """A mesh of triangular prisms; node (k, n) is the section's node n in slice k.

    Attributes:
        section: the reference section.
        z: positions of the slices, mm, shape (slices,).
        x, y: positions of the nodes, mm, shape (slices, section nodes).
    """

    section: CrossSection
    z: Array
    x: Array
    y: Array

    @property
    def unknowns(self) -> int:
        """Nodes whose potential is not prescribed."""
        return len(self.z) * (self.x.shape[1] - len(self.section.boundary))

    def fibre_directions(self) -> Array:
        """Unit vectors along the extruded columns, shape (3, slices - 1, triangles).

        The fibres of the white matter run with the cord's surface, so they tilt where the cord tapers.
        """
        triangles = self.section.triangles
        rise = np.diff(self.z)[:, None] * np.ones(triangles.shape[1])
        along = np.stack([np.diff(c, axis=0)[:, triangles].mean(axis=1) for c in (self.x, self.y)] + [rise])
        return along / np.linalg.norm(along, axis=0)


def extrude(section: CrossSection, z: Array, slice_map: SliceMap) -> PrismMesh:
    """Extrude a section along `z`.

    Args:
        section: the reference section.
        z: increasing positions of the slices, mm.
        slice_map: (x, y, z) of reference nodes, broadcast to (slices, nodes) -> their x and y.

    Raises:
        AnatomyError: the map folds a triangle over.
    """
    x, y = slice_map(section.nodes[0][None], section.nodes[1][None], z[:, None])
    shape = (len(z), section.nodes.shape[1])
    x, y = (np.ascontiguousarray(np.broadcast_to(c, shape)) for c in (x, y))
    (xa, xb, xc), (ya, yb, yc) = (c[:, section.triangles].swapaxes(0, 1) for c in (x, y))
    area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)
    if area.min() <= 0:
        folded = z[(area <= 0).any(axis=1)]
        raise AnatomyError(
            f"the section folds over between z = {folded.min():g} and {folded.max():g} mm: "
            "the cord changes its size too much"
        )
    return PrismMesh(section, z, x, y)


def cord_mesh(anatomy: Anatomy, section: CrossSection, step: float) -> PrismMesh:
    """The mesh of the whole model; `step` is the distance of the slices along cord and paddle, mm."""
    low = min(anatomy.place("L1", end=False), anatomy.paddle_rostral_edge) - _CORE_MARGIN
    high = max(float(anatomy.borders[-1]), anatomy.paddle_rostral_edge + anatomy.paddle_length) + _CORE_MARGIN
    z = graded_axis(anatomy.rostral_end, low, high, anatomy.caudal_end, step)
    return extrude(section, z, cord_map(anatomy))


def cord_map(anatomy: Anatomy) -> SliceMap:
    """The map that gives the reference section's cord the width and depth it has at z.

    The scaling fades out linearly between the cord's surface and a similar ellipse inside the sac.
    """
    a, b = anatomy.half_width, anatomy.half_depth
    sac = anatomy.sac_outline(np.linspace(0, np.pi / 2, 181))
    fade = _BLENDING * (np.hypot(*(sac / [a, b]).T).min() - 1)
    borders, segments = anatomy.borders, anatomy.segments
    middle = (borders[1:] + borders[:-1]) / 2
    at = np.concatenate(
        [[anatomy.rostral_end - 1], middle, borders[-1] + [c[0] for c in CONUS], [anatomy.caudal_end + 1]]
    )
    widths = [segments[0].width, *(s.width for s in segments), *(c[1] for c in CONUS), CONUS[-1][1]]
    depths = [segments[0].depth, *(s.depth for s in segments), *(c[2] for c in CONUS), CONUS[-1][2]]
    scale_x = PchipInterpolator(at, np.array(widths) / 2 / a)
    scale_y = PchipInterpolator(at, np.array(depths) / 2 / b)

    def place(x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        radius = np.hypot(x / a, y / b)
        share = np.clip(1 - (radius - 1) / fade, 0, 1)
        return x * (1 + (scale_x(z) - 1) * share), y * (1 + (scale_y(z) - 1) * share)

    return place


def graded_axis(low: float, core_low: float, core_high: float, high: float, step: float) -> Array:
    """Slices `step` apart from core_low to core_high, growing apart towards low and high."""
    count = max(1, round((core_high - core_low) / step))
    core = np.linspace(core_low, core_high, count + 1)
    step = core[1] - core[0]
    return np.concatenate(
        [core_low - _tail(core_low - low, step)[::-1], core, core_high + _tail(high - core_high, step)]
    )


def _tail(length: float, step: float) -> Array:
    """Increasing distances that end at `length`, with growing steps."""
    distances = []
    at = 0.0
    while length - at > 1e-9:
        step = min(step * _AXIS_GROWTH, _LARGEST_STEP)
        at = length if length - at < 1.6 * step else at + step
        distances.append(at)
    return np.array(distances)
