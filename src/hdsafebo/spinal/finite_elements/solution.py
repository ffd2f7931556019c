"""Solution of the volume conductor: potentials of 1 mA through each contact, and what proves them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdsafebo.spinal.finite_elements.assembly import Contact, contact_currents, stiffness
from hdsafebo.spinal.finite_elements.solver import FastDiagonalisation, conjugate_gradients
from hdsafebo.spinal.geometry.anatomy import CONTACT_LENGTH, CONTACT_WIDTH, Anatomy
from hdsafebo.spinal.geometry.conductivity import Conductivity
from hdsafebo.spinal.geometry.mesh import PrismMesh
from hdsafebo.spinal.lead_field import MILLIVOLTS, LeadField

Array = NDArray[np.float64]

_BATCH = 8  # contacts solved side by side; bounds the memory


@dataclass(frozen=True)
class Solution:
    """Potentials and what proves them.

    Attributes:
        potential: V per mA, shape (slices, nodes, contacts).
        iterations: of the conjugate gradients.
        unknowns: of the linear system.
        resistance: potential of contact i per mA through contact j, V/mA, shape (contacts, contacts).
        outflow: share of each contact's current that leaves through the outer surface, shape (contacts,).
    """

    potential: Array
    iterations: int
    unknowns: int
    resistance: Array
    outflow: Array

    @property
    def reciprocity_error(self) -> float:
        """Largest |R - R'| relative to the entry; zero for an exact solution."""
        return float(np.max(np.abs(self.resistance - self.resistance.T) / np.abs(self.resistance)))

    @property
    def current_error(self) -> float:
        """Largest difference between the current that enters and that leaves, relative."""
        return float(np.max(np.abs(self.outflow - 1)))


def cord_contacts(anatomy: Anatomy, mesh: PrismMesh) -> list[Contact]:
    """The 16 contacts on the paddle's face."""
    edges = mesh.section.contact_edges
    x, y = mesh.section.nodes[:, edges]
    on_face = np.all(np.abs(y - anatomy.paddle_face) < 1e-6, axis=1)
    return [
        Contact(
            edges[on_face & np.all(np.abs(x - centre) < CONTACT_WIDTH / 2 + 1e-6, axis=1)],
            z - CONTACT_LENGTH / 2,
            z + CONTACT_LENGTH / 2,
        )
        for centre, z in anatomy.contacts()
    ]


def solve(
    mesh: PrismMesh, conductivity: Conductivity, contacts: list[Contact], tolerance: float = 1e-8
) -> Solution:
    """Potentials of 1 mA through each contact; zero on the outer surface, ends insulated.

    Args:
        mesh: prisms.
        conductivity: of every prism.
        contacts: where the currents enter.
        tolerance: of the relative residual.

    Raises:
        LeadFieldError: the iterations do not converge.
    """
    nodes = mesh.x.shape[1]
    free = np.setdiff1d(np.arange(nodes), mesh.section.boundary)
    unknown = (np.arange(len(mesh.z))[:, None] * nodes + free).ravel()
    loads = contact_currents(mesh, contacts)
    fixed = np.setdiff1d(np.arange(len(loads)), unknown)
    matrix = stiffness(mesh, conductivity)
    outer, matrix = matrix[fixed], matrix[unknown][:, unknown]
    precondition = FastDiagonalisation(mesh, conductivity, free)
    potential, iterations = np.zeros_like(loads), 0
    for first in range(0, len(contacts), _BATCH):
        batch = np.s_[first : first + _BATCH]
        values, needed = conjugate_gradients(
            matrix, loads[unknown, batch], precondition, tolerance, "Lead fields"
        )
        potential[unknown, batch] = values
        iterations = max(iterations, needed)
    outflow = loads[fixed].sum(axis=0) - np.asarray(outer @ potential).sum(axis=0)
    return Solution(
        potential.reshape(len(mesh.z), nodes, -1), iterations, len(unknown), loads.T @ potential, outflow
    )


def as_lead_field(mesh: PrismMesh, anatomy: Anatomy, solution: Solution) -> LeadField:
    """The solution together with the mesh it lives on."""
    section = mesh.section
    return LeadField(
        section.nodes, section.triangles, section.tissue, np.array(section.tissues), mesh.z, mesh.x, mesh.y,
        anatomy.contacts(), anatomy.borders, solution.potential * MILLIVOLTS,
    )  # fmt: skip
