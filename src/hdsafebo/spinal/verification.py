"""The production solver on the layered cylinder, and how far it is from the exact solution.

The same triangulation, extrusion, assembly, solver and activating function as for the cord. With `bulge`
the columns of nodes are bent: circles swell and shrink along z inside each layer while the interfaces
stay where they are, so the mapped prisms of the cord are verified against the same exact solution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdsafebo.spinal.activating_function import INTERNODE, along_fibres, potential_on_fibres
from hdsafebo.spinal.finite_elements.assembly import Contact
from hdsafebo.spinal.finite_elements.reference_cylinder import LayeredCylinder
from hdsafebo.spinal.finite_elements.solution import Solution, solve
from hdsafebo.spinal.geometry.conductivity import Conductivity
from hdsafebo.spinal.geometry.mesh import PrismMesh, SliceMap, extrude, graded_axis
from hdsafebo.spinal.geometry.section import CrossSection, EdgeLengths, build_section, circle, graded_size
from hdsafebo.spinal.lead_field import MILLIVOLTS, LeadField

Array = NDArray[np.float64]

RADII = np.array([0.0, 2.0, 4.0])  # mm, of the compared fibres, below the patch
_CORE = 25.0  # mm of fine slices on either side of the patch
_PERIOD = 20.0  # mm, of the bulges
_COMPARED = 20.0  # mm on either side of the patch


@dataclass(frozen=True)
class Errors:
    """Largest error over a fibre relative to the largest value, one per fibre of `RADII`.

    Attributes:
        potential: of V.
        activating: of the activating function (second difference over 1 mm).
        unknowns: of the linear system.
        solution: reciprocity, current balance and iterations of the same solve.
    """

    potential: Array
    activating: Array
    unknowns: int
    solution: Solution


def cylinder_section(cylinder: LayeredCylinder, lengths: EdgeLengths) -> CrossSection:
    """The cylinder's section; the patch's borders are vertices of its interface."""
    source = cylinder.radii[cylinder.source]
    regions = {
        f"layer {i}": circle(f"layer {i}", r, [cylinder.half_arc] if i == cylinder.source else [])
        for i, r in enumerate(cylinder.radii)
    }
    size = graded_size(lengths, (cylinder.radii[0],) * 2, (cylinder.half_arc, source))
    return build_section(regions, size, contacts_on=f"layer {cylinder.source}")


def bulging(cylinder: LayeredCylinder, amplitude: float) -> SliceMap:
    """A slice map that moves the nodes of the two inner layers radially by up to `amplitude` mm."""
    core, csf = cylinder.radii[:2]

    def place(x: Array, y: Array, z: Array) -> tuple[Array, Array]:
        r = np.hypot(x, y)
        inner, outer = np.sin(np.pi * r / core), np.sin(np.pi * (r - core) / (csf - core))
        wave = amplitude * np.sin(2 * np.pi * (z - cylinder.centre) / _PERIOD + 1.0)
        shift = np.where(r < core, inner, np.where(r < csf, -outer, 0.0)) * wave
        factor = 1 + shift / np.where(r > 0, r, 1.0)
        return x * factor, y * factor

    return place


def cylinder_field(
    cylinder: LayeredCylinder, lengths: EdgeLengths, step: float, bulge: float = 0.0
) -> tuple[LeadField, Solution]:
    """Lead fields of the patch and of a second one further along, by the production solver."""
    section = cylinder_section(cylinder, lengths)
    z = graded_axis(0.0, cylinder.centre - _CORE, cylinder.centre + _CORE, cylinder.length, step)
    mesh = extrude(section, z, bulging(cylinder, bulge))
    patches = _patches(cylinder, section)
    solution = solve(mesh, _conductivity(cylinder, mesh), patches)
    contacts = np.array([[0.0, (p.low + p.high) / 2] for p in patches])
    field = LeadField(
        section.nodes, section.triangles, section.tissue, np.array(section.tissues), z, mesh.x, mesh.y,
        contacts, np.array([0.0, cylinder.length]), solution.potential * MILLIVOLTS,
    )  # fmt: skip
    return field, solution


def cylinder_errors(
    cylinder: LayeredCylinder, lengths: EdgeLengths, step: float, bulge: float = 0.0
) -> Errors:
    """Compare potential and activating function with the exact solution on the same fibres."""
    field, solution = cylinder_field(cylinder, lengths, step, bulge)
    points = np.stack([np.zeros(len(RADII)), RADII], axis=1)
    near = np.abs(field.z - cylinder.centre) <= _COMPARED
    place = bulging(cylinder, bulge)

    def exact(z: Array) -> Array:
        _, r = place(points[:, :1], points[:, 1:], z[None])
        return cylinder.potential(np.abs(r), 0.0, z[None])[0] * MILLIVOLTS

    heights = cylinder.centre + np.arange(-_COMPARED - INTERNODE, _COMPARED + 1.5 * INTERNODE, INTERNODE)
    second = np.diff(exact(heights), n=2, axis=1) / INTERNODE**2
    return Errors(
        _relative(potential_on_fibres(field, points)[near, :, 0].T, exact(field.z[near])),
        _relative(along_fibres(field, points, heights[1:-1])[0].T, second),
        solution.unknowns,
        solution,
    )


def _relative(found: Array, expected: Array) -> Array:
    return np.asarray(np.abs(found - expected).max(axis=1) / np.abs(expected).max(axis=1))


def _patches(cylinder: LayeredCylinder, section: CrossSection) -> list[Contact]:
    """The patch at the dorsal pole of its interface, and the same one 12 mm further along."""
    x, y = section.nodes[:, section.contact_edges]
    covered = np.all((np.abs(np.arctan2(x, y)) * np.hypot(x, y) < cylinder.half_arc + 1e-6) & (y > 0), axis=1)
    edges = section.contact_edges[covered]
    return [
        Contact(
            edges,
            cylinder.centre + shift - cylinder.half_length,
            cylinder.centre + shift + cylinder.half_length,
        )
        for shift in (0.0, 12.0)
    ]


def _conductivity(cylinder: LayeredCylinder, mesh: PrismMesh) -> Conductivity:
    shape = (len(mesh.z) - 1, len(mesh.section.tissue))
    across, along = (
        np.broadcast_to(np.array(values)[mesh.section.tissue], shape)
        for values in (cylinder.across, cylinder.along)
    )
    direction = np.zeros((3, *shape))
    direction[2] = 1.0
    return Conductivity(across, along, direction)
