"""Conjugate gradients over all contacts at once, preconditioned by fast diagonalisation.

The preconditioner is the model averaged along z: a prism of one section, whose stiffness is
K_z (x) M + M_z (x) K. The generalised eigenvectors of (K_z, M_z) turn it into one sparse system of the
section's size per eigenvalue (Lynch, Rice & Thomas 1964, Numer Math 6:185), factored once.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg
import skfem
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu
from skfem.helpers import dot, grad

from hdsafebo.progress import progress
from hdsafebo.spinal.geometry.conductivity import Conductivity
from hdsafebo.spinal.geometry.mesh import PrismMesh
from hdsafebo.spinal.lead_field import LeadFieldError

Array = NDArray[np.float64]

_MOST_ITERATIONS = 200


@skfem.BilinearForm
def _laplace(u, v, w):  # type: ignore[no-untyped-def]
    return w.s * dot(grad(u), grad(v))


@skfem.BilinearForm
def _mass(u, v, w):  # type: ignore[no-untyped-def]
    return w.s * u * v


class FastDiagonalisation:
    """Inverse of the stiffness matrix of the z-averaged model, on the free nodes of each slice."""

    def __init__(self, mesh: PrismMesh, conductivity: Conductivity, free: NDArray[np.intp]) -> None:
        weight = np.diff(mesh.z)
        axis = skfem.Basis(skfem.MeshLine(mesh.z), skfem.ElementLineP1())
        one = np.ones(axis.dx.shape)
        eigenvalues, self._modes = scipy.linalg.eigh(
            _laplace.assemble(axis, s=one).toarray(), _mass.assemble(axis, s=one).toarray()
        )
        layer = np.concatenate([[0.0], weight]) + np.concatenate([weight, [0.0]])
        nodes = np.average(np.stack([mesh.x, mesh.y]), axis=1, weights=layer)
        section = skfem.Basis(skfem.MeshTri(nodes, mesh.section.triangles), skfem.ElementTriP1())
        points = section.dx.shape[1]
        across, along = (
            np.repeat(np.average(c, axis=0, weights=weight)[:, None], points, axis=1)
            for c in (conductivity.across, conductivity.along)
        )
        stiff = _laplace.assemble(section, s=across)[free][:, free]
        mass = _mass.assemble(section, s=along)[free][:, free]
        options = {"SymmetricMode": True}
        self._factors = [
            splu(
                (stiff + max(e, 0.0) * mass).tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options=options,
            )
            for e in eigenvalues
        ]

    def __call__(self, residual: Array) -> Array:
        """Solve for residuals of shape (slices * free, columns)."""
        slices, columns = len(self._factors), residual.shape[1]
        modal = (self._modes.T @ residual.reshape(slices, -1)).reshape(slices, -1, columns)
        for mode, factor in zip(modal, self._factors, strict=True):
            mode[:] = factor.solve(mode)
        return (self._modes @ modal.reshape(slices, -1)).reshape(residual.shape)


def conjugate_gradients(
    matrix: csr_matrix,
    loads: Array,
    precondition: Callable[[Array], Array],
    tolerance: float,
    description: str,
) -> tuple[Array, int]:
    """Solve matrix @ x = loads for all columns side by side.

    Args:
        matrix: symmetric positive definite, shape (n, n).
        loads: shape (n, columns).
        precondition: approximate inverse, applied to (n, columns).
        tolerance: bound on |residual| / |load| of every column.
        description: of the progress; its unit is a power of ten of the residual.

    Returns:
        The solutions, shape (n, columns), and the number of iterations.

    Raises:
        LeadFieldError: the tolerance was not reached.
    """
    solution, residual = np.zeros_like(loads), loads.copy()
    scale = np.linalg.norm(loads, axis=0)
    preconditioned = precondition(residual)
    direction = preconditioned.copy()
    product = np.sum(residual * preconditioned, axis=0)
    digits = int(np.ceil(-np.log10(tolerance)))
    with progress(digits, description) as advance:
        done = 0
        for iteration in range(1, _MOST_ITERATIONS + 1):
            image = matrix @ direction
            step = product / np.sum(direction * image, axis=0)
            solution += step * direction
            residual -= step * image
            error = float(np.max(np.linalg.norm(residual, axis=0) / scale))
            if not np.isfinite(error):
                raise LeadFieldError(f"the potential is not finite after {iteration} iterations")
            reached = max(done, min(digits, int(-np.log10(max(error, tolerance)))))
            advance(reached - done, f"residual {error:.0e}")
            done = reached
            if error <= tolerance:
                return solution, iteration
            preconditioned = precondition(residual)
            new = np.sum(residual * preconditioned, axis=0)
            direction = preconditioned + (new / product) * direction
            product = new
    raise LeadFieldError(
        f"the potential has a relative residual of {error:.1e} after {_MOST_ITERATIONS} iterations, "
        f"expected {tolerance:.1e}"
    )
