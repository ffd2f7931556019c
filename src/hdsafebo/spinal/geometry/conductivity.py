"""Conductivity of every prism: across and along the fibres, and the fibres' direction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import AnatomyError, UnknownNameError
from hdsafebo.spinal.geometry.anatomy import CONDUCTIVITIES, Anatomy
from hdsafebo.spinal.geometry.mesh import PrismMesh

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Conductivity:
    """A transversely isotropic conductor: sigma = across * I + (along - across) * d d'.

    Attributes:
        across, along: S/m, shape (slices - 1, triangles).
        direction: unit vectors d along the fibres, shape (3, slices - 1, triangles).
    """

    across: Array
    along: Array
    direction: Array


def conductivity_table(values: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """The tissues' conductivities (across, along) in S/m, with some replaced.

    Args:
        values: tissue -> S/m, or `white_across`, `white_along` for the one anisotropic tissue.

    Raises:
        UnknownNameError: no such tissue.
        AnatomyError: a conductivity is not a positive finite number.
    """
    names = [n for n in CONDUCTIVITIES if n != "white"] + ["white_across", "white_along"]
    for name, value in values.items():
        if name not in names:
            raise UnknownNameError("tissue", name, names)
        if not (np.isfinite(value) and value > 0):
            raise AnatomyError(f"the conductivity of {name} is {value} S/m, expected a positive number")
    table = {n: (values.get(n, pair[0]),) * 2 for n, pair in CONDUCTIVITIES.items() if n != "white"}
    across, along = CONDUCTIVITIES["white"]
    return table | {"white": (values.get("white_across", across), values.get("white_along", along))}


def cord_conductivity(
    anatomy: Anatomy, mesh: PrismMesh, table: Mapping[str, tuple[float, float]]
) -> Conductivity:
    """Conductivity of the model: the section's tissues; fat stands in the paddle's place beyond its ends."""
    section = mesh.section
    middle = (mesh.z[1:] + mesh.z[:-1]) / 2
    beyond = (
        np.abs(middle - anatomy.paddle_rostral_edge - anatomy.paddle_length / 2) > anatomy.paddle_length / 2
    )
    swap = beyond[:, None] & section.in_tissue("paddle")
    across, along = (np.array([table[t][i] for t in section.tissues])[section.tissue] for i in (0, 1))
    fat = table["fat"]
    return Conductivity(
        np.where(swap, fat[0], across), np.where(swap, fat[1], along), mesh.fibre_directions()
    )
