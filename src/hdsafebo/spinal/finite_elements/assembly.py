"""Finite-element matrices: prisms of first order for div(sigma grad V) = 0, and the contacts' currents.

With lengths in mm, conductivities in S/m and currents in mA, potentials come out in volts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from skfem.helpers import dot, grad

from hdsafebo.errors import AnatomyError
from hdsafebo.spinal.geometry.conductivity import Conductivity
from hdsafebo.spinal.geometry.mesh import PrismMesh

Array = NDArray[np.float64]

_LAYERS_PER_CHUNK = 12  # bounds the memory of the assembly
# Gauss points of the reference prism, 3 in the triangle times 2 along the axis. scikit-fem's own rule for
# wedges integrates 1 to 0.25 where the volume is 0.5 (release 12.0.2).
_GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)
_QUADRATURE = (
    np.array([[a, b, c] for c in _GAUSS for a, b in ((1 / 6, 1 / 6), (2 / 3, 1 / 6), (1 / 6, 2 / 3))]).T,
    np.full(6, 1 / 12),
)


@dataclass(frozen=True)
class Contact:
    """A contact of unit current density: the edges of the section that it covers, between two heights.

    Attributes:
        edges: node numbers, shape (edges, 2).
        low, high: mm along z.
    """

    edges: NDArray[np.intp]
    low: float
    high: float


@skfem.BilinearForm
def _current(u, v, w):  # type: ignore[no-untyped-def]
    """sigma grad u . grad v, with sigma = across I + (along - across) d d'."""
    return w.across * dot(grad(u), grad(v)) + w.extra * dot(w.d, grad(u)) * dot(w.d, grad(v))


def stiffness(mesh: PrismMesh, conductivity: Conductivity) -> csr_matrix:
    """The stiffness matrix, shape (slices * nodes, slices * nodes), node (k, n) at k * nodes + n."""
    count = mesh.x.shape[1]
    size = len(mesh.z) * count
    total = csr_matrix((size, size))
    for first in range(0, len(mesh.z) - 1, _LAYERS_PER_CHUNK):
        last = min(first + _LAYERS_PER_CHUNK, len(mesh.z) - 1)
        part = coo_matrix(_chunk(mesh, conductivity, first, last))
        total = total + csr_matrix(
            (part.data, (part.row + first * count, part.col + first * count)), shape=(size, size)
        )
    return total


def _chunk(mesh: PrismMesh, conductivity: Conductivity, first: int, last: int) -> csr_matrix:
    """Stiffness of the layers first .. last - 1, in the numbering of their own slices."""
    triangles, count = mesh.section.triangles, mesh.x.shape[1]
    cut = slice(first, last + 1)
    nodes = np.stack([mesh.x[cut].ravel(), mesh.y[cut].ravel(), np.repeat(mesh.z[cut], count)])
    prisms = np.hstack(
        [np.vstack([triangles + k * count, triangles + (k + 1) * count]) for k in range(last - first)]
    )
    basis = skfem.Basis(skfem.MeshWedge1(nodes, prisms), skfem.ElementWedge1(), quadrature=_QUADRATURE)
    points = len(_QUADRATURE[1])

    def spread(values: Array) -> Array:
        return np.repeat(values.reshape(*values.shape[:-2], -1, 1), points, axis=-1)

    across, along = conductivity.across[first:last], conductivity.along[first:last]
    return _current.assemble(
        basis,
        across=spread(across),
        extra=spread(along - across),
        d=spread(conductivity.direction[:, first:last]),
    )


def contact_currents(mesh: PrismMesh, contacts: list[Contact]) -> Array:
    """Load of 1 mA through each contact, evenly over its area, shape (slices * nodes, contacts).

    The integrals of the shape functions over the patch are exact.

    Raises:
        AnatomyError: a contact covers no edge of the section or leaves the model.
    """
    loads = np.zeros((len(mesh.z), mesh.x.shape[1], len(contacts)))
    for i, contact in enumerate(contacts):
        if len(contact.edges) == 0 or not mesh.z[0] <= contact.low < contact.high <= mesh.z[-1]:
            raise AnatomyError(
                f"contact {i + 1} covers no part of the mesh ({contact.low:g} to {contact.high:g} mm)"
            )
        across = np.zeros(mesh.x.shape[1])
        length = np.hypot(*np.diff(mesh.section.nodes[:, contact.edges], axis=2)[..., 0])
        np.add.at(across, contact.edges, np.repeat(length[:, None] / 2, 2, axis=1))
        along = _hat_integrals(mesh.z, contact.low, contact.high)
        loads[..., i] = np.outer(along, across) / (length.sum() * (contact.high - contact.low))
    return loads.reshape(-1, len(contacts))


def _hat_integrals(z: Array, low: float, high: float) -> Array:
    """Integrals of the piecewise linear shape functions of an axis over [low, high], shape (slices,)."""
    start, end = np.clip(z[:-1], low, high), np.clip(z[1:], low, high)
    middle = ((start + end) / 2 - z[:-1]) / np.diff(z)
    integrals = np.zeros(len(z))
    integrals[:-1] += (1 - middle) * (end - start)
    integrals[1:] += middle * (end - start)
    return integrals
