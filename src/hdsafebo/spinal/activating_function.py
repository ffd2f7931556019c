"""The activating function along the cord's fibres, sampled at points of equal volume.

The activating function of a myelinated axon is the second difference of the extracellular potential over
its nodes (Rattay 1986, IEEE Trans Biomed Eng 33:974): (V(z - d) - 2 V(z) + V(z + d)) / d^2, here with nodes
d = 1 mm apart, as on a fibre of 10 um (Rushton 1951, J Physiol 115:101: about 100 diameters), along the
columns of the mesh, which follow the cord. It is linear in the currents; `muscles` takes its absolute value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hdsafebo.errors import AnatomyError
from hdsafebo.spinal.lead_field import LeadField

Array = NDArray[np.float64]

INTERNODE = 1.0  # mm
SIDES = ("left", "right")
_CORD = ("grey", "white")


@dataclass(frozen=True)
class ActivatingFunction:
    """Unit activating functions at points that stand for equal volumes of the cord.

    Attributes:
        points: reference coordinates (x, y) of a half section's points, mm, shape (points, 2), x > 0.
        z: sampled heights, mm, shape (slices,).
        unit: mV/mm^2 per mA, shape (contacts, sides, slices, points); the left side is the mirror image.
    """

    points: Array
    z: Array
    unit: Array


def sample(field: LeadField, low: float, high: float, spacing: float, slices: int) -> ActivatingFunction:
    """Sample the activating function of every contact.

    Args:
        field: lead fields.
        low, high: mm, the part of the cord to sample.
        spacing: of the square grid of points in the reference section, mm.
        slices: number of heights; each stands for the same volume of the cord.

    Raises:
        AnatomyError: no point falls into the cord, or the part reaches beyond the model.
    """
    if not field.z[0] < low - INTERNODE < high + INTERNODE < field.z[-1]:
        raise AnatomyError(
            f"cannot sample from {low:g} to {high:g} mm in a model from {field.z[0]:g} to {field.z[-1]:g} mm"
        )
    points = _half_grid(field, spacing)
    z = equal_volume_heights(field, low, high, slices)
    unit = np.stack([along_fibres(field, points * [sign, 1], z) for sign in (-1, 1)], axis=1)
    return ActivatingFunction(points, z, unit)


def along_fibres(field: LeadField, points: Array, z: Array) -> Array:
    """Unit activating functions on the fibres through reference points.

    Args:
        field: lead fields.
        points: (x, y) in the reference section, mm, shape (points, 2).
        z: heights, mm, shape (slices,).

    Returns:
        mV/mm^2 per mA, shape (contacts, slices, points).
    """
    spline = CubicSpline(field.z, potential_on_fibres(field, points), axis=0)
    second = (spline(z - INTERNODE) - 2 * spline(z) + spline(z + INTERNODE)) / INTERNODE**2
    return np.ascontiguousarray(second.transpose(2, 0, 1))


def potential_on_fibres(field: LeadField, points: Array) -> Array:
    """Potential of the fibres through reference points at every slice of the mesh.

    Returns:
        mV per mA, shape (slices, points, contacts).
    """
    mesh = skfem.MeshTri(field.section_nodes, field.triangles)
    weights = skfem.Basis(mesh, skfem.ElementTriP1()).probes(points.T)
    return np.stack([weights @ values for values in np.asarray(field.potential, dtype=float)])


def equal_volume_heights(field: LeadField, low: float, high: float, slices: int) -> Array:
    """Heights in the middle of `slices` pieces of the cord of equal volume, mm."""
    fine = np.linspace(low, high, 2001)
    area = np.interp(fine, field.z, cord_areas(field))
    volume = np.concatenate([[0.0], np.cumsum((area[1:] + area[:-1]) / 2 * np.diff(fine))])
    return np.interp((np.arange(slices) + 0.5) / slices * volume[-1], volume, fine)


def cord_areas(field: LeadField) -> Array:
    """Area of the cord's section at every slice of the mesh, mm^2, shape (slices,)."""
    triangles = field.triangles[:, _in_cord(field, _CORD)]
    (xa, xb, xc), (ya, yb, yc) = (c[:, triangles].swapaxes(0, 1) for c in (field.x, field.y))
    return ((xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)).sum(axis=1) / 2


def _in_cord(field: LeadField, names: Sequence[str]) -> NDArray[np.bool_]:
    return np.isin(field.tissue, [list(field.tissues).index(n) for n in names])


def _half_grid(field: LeadField, spacing: float) -> Array:
    """Points of a square grid in the right half of the reference section's cord, shape (points, 2)."""
    cord = _in_cord(field, _CORD)
    reach = np.abs(field.section_nodes[:, np.unique(field.triangles[:, cord])]).max(axis=1)
    x = np.arange(spacing / 2, reach[0], spacing)
    y = np.arange(spacing / 2, reach[1], spacing)
    grid = np.stack(np.meshgrid(x, np.concatenate([-y[::-1], y]), indexing="ij"), axis=-1).reshape(-1, 2)
    if len(grid):
        element = skfem.MeshTri(field.section_nodes, field.triangles).element_finder()(*grid.T)
        grid = grid[cord[element]]
    if len(grid) == 0:
        raise AnatomyError(f"a sample spacing of {spacing:g} mm leaves no point in the cord")
    return grid
