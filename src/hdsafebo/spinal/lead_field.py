"""Lead fields: the potential that 1 mA through each contact raises everywhere."""

from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import HdSafeBOError
from hdsafebo.files.bounded import open_regular
from hdsafebo.spinal.geometry.anatomy import Anatomy

Array = NDArray[np.float64]

MILLIVOLTS = 1e3
_ARRAYS = (
    "section_nodes", "triangles", "tissue", "tissues", "z", "x", "y", "contacts", "borders", "potential",
)  # fmt: skip


class LeadFieldError(HdSafeBOError):
    """The potential could not be computed, or a lead field file is not what it should be."""


@dataclass(frozen=True)
class LeadField:
    """Potentials of unit currents, against the outer surface of the model.

    Attributes:
        section_nodes: reference section, mm, shape (2, nodes).
        triangles: shape (3, triangles).
        tissue: index into `tissues`, shape (triangles,).
        tissues: names, shape (tissues,).
        z: slices, mm, shape (slices,).
        x, y: nodes of each slice, mm, shape (slices, nodes).
        contacts: centres (x, z) in mm, shape (contacts, 2).
        borders: of the cord's segments along z, mm, shape (segments + 1,).
        potential: mV per mA, shape (slices, nodes, contacts).
    """

    section_nodes: Array
    triangles: NDArray[np.intp]
    tissue: NDArray[np.intp]
    tissues: NDArray[np.str_]
    z: Array
    x: Array
    y: Array
    contacts: Array
    borders: Array
    potential: NDArray[np.floating]

    def save(self, path: Path) -> None:
        """Write an .npz of plain arrays; the potential in single precision."""
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        np.savez_compressed(path, **arrays | {"potential": self.potential.astype(np.float32)})

    @classmethod
    def load(cls, path: Path) -> LeadField:
        """Read a file that `save` wrote.

        Raises:
            LeadFieldError: the file is missing, damaged, holds other arrays, or they do not fit together.
        """
        try:
            with open_regular(path) as handle, np.load(handle, allow_pickle=False) as file:
                found = cls(**{name: file[name] for name in _ARRAYS})
        except FileNotFoundError as error:
            raise LeadFieldError(f"{path}: no such file; the stage solve_lead_field writes it") from error
        except (
            OSError,
            ValueError,
            KeyError,
            EOFError,
            NotImplementedError,
            zipfile.BadZipFile,
            zlib.error,
        ) as error:
            raise LeadFieldError(f"{path}: not a lead field: {error}") from error
        slices, nodes = found.x.shape if found.x.ndim == 2 else (0, 0)
        expected = {
            "section_nodes": (2, nodes),
            "z": (slices,),
            "y": (slices, nodes),
            "potential": (slices, nodes, len(found.contacts)),
        }
        for name, shape in expected.items():
            value = getattr(found, name)
            if value.shape != shape or not np.isfinite(value).all():
                raise LeadFieldError(
                    f"{path}: {name} has shape {value.shape}, expected {shape} of finite numbers"
                )
        return found

    def require(self, anatomy: Anatomy) -> None:
        """Raise LeadFieldError unless segments and contacts are those that the field was solved with."""
        for name, mine, wanted in (
            ("segments", self.borders, anatomy.borders),
            ("contacts", self.contacts, anatomy.contacts()),
        ):
            if mine.shape != wanted.shape or np.abs(mine - wanted).max() > 1e-9:
                raise LeadFieldError(
                    f"the lead fields were solved with other {name} than the parameters have; "
                    "solve them again"
                )
