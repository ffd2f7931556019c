"""Field maps: the pictures of a stimulation that an embedding compresses.

Where the current enters and leaves matters more than the numbers of the contacts, so a configuration and
a current become a simplified electric field picture of 52 x 14 pixels of one millimetre, rows along the
cord (rostral first), columns across (paper, stimulation task: "an electric field map with 52 x 14 pixels
using simplified computation").

With M the mean of 1/|q - p| over the cathodes' pixels p, and S the sum of 1/|q - p| over the anodes'
pixels, the unit potential of pixel q is -0.2 M / (S + M); it is -1 on a cathode's pixels and 0 on an
anode's. The map of a current I is affine in the current:

    map = 1 + (I / 5 mA) * unit potential

All 21,800 unit potentials take two matrix products.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdsafebo.errors import DatasetError

ROWS, COLUMNS = 52, 14  # pixels of 1 mm
PIXELS = ROWS * COLUMNS
CONTACTS = 16
CONTACT_LENGTH = 3  # pixels along the cord; a contact is one pixel wide
REFERENCE_CURRENT_MA = 5.0  # the map of this current is 1 + unit potential
BACKGROUND = 1.0  # the map without any current
FIELD_SCALE = 0.2  # potential between the contacts, relative to the cathode's
CATHODE_POTENTIAL, ANODE_POTENTIAL = -1.0, 0.0


def contact_pixels() -> NDArray[np.intp]:
    """Flat pixel indices of each contact, shape (16, 3).

    Contacts 1-8 have their top pixel at rows 6, 12, ..., 48 of column 3, contacts 9-16 at rows
    3, 9, ..., 45 of column 6 (counting from 1).
    """
    top = np.concatenate([np.arange(6, 49, 6), np.arange(3, 46, 6)]) - 1
    column = np.repeat([3, 6], 8) - 1
    rows = top[:, None] + np.arange(CONTACT_LENGTH)
    return rows * COLUMNS + column[:, None]


def unit_potentials(configurations: ArrayLike) -> NDArray[np.float64]:
    """Simplified potentials of contact configurations at the reference current.

    Args:
        configurations: polarity of each contact, -1 cathode, 0 off, +1 anode, shape (n, 16).

    Returns:
        Dimensionless potentials in [-1, 0], shape (n, 728), row-major pixels.

    Raises:
        DatasetError: wrong shape, another polarity, or a configuration without a cathode or an anode.
    """
    polarity = _checked(configurations)
    pixels = contact_pixels()
    kernel = _inverse_distances(pixels)
    cathodes, anodes = (polarity < 0).astype(float), (polarity > 0).astype(float)
    attraction = cathodes @ kernel / (CONTACT_LENGTH * cathodes.sum(axis=1, keepdims=True))
    potential = -FIELD_SCALE * attraction / (anodes @ kernel + attraction)
    _paint(potential, pixels, polarity < 0, CATHODE_POTENTIAL)
    _paint(potential, pixels, polarity > 0, ANODE_POTENTIAL)
    return potential


def field_maps(unit: ArrayLike, current_ma: ArrayLike) -> NDArray[np.float64]:
    """Maps of unit potentials (n, 728) at currents in mA (a number or (n,)): 1 + (I / 5 mA) * unit."""
    strength = np.asarray(current_ma, dtype=float) / REFERENCE_CURRENT_MA
    return BACKGROUND + strength[..., None] * np.asarray(unit, dtype=float)


@dataclass(frozen=True)
class RandomCurrents:
    """Training source for embeddings: each call draws a new current for every map.

    An embedding that is fitted on the 21,800 maps of the reference current, with a fresh draw per epoch,
    sees the whole set of 218,000 maps at a tenth of the cost.

    Attributes:
        currents_ma: the currents to draw from, in mA.
    """

    currents_ma: tuple[float, ...]

    def __call__(self, reference_maps: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """Maps (n, 728) of the reference current, rescaled to one random current each."""
        drawn = rng.choice(np.asarray(self.currents_ma), size=len(reference_maps))
        return field_maps(reference_maps - BACKGROUND, drawn)


def _inverse_distances(pixels: NDArray[np.intp]) -> NDArray[np.float64]:
    """Sum over a contact's pixels p of 1/|q - p|, shape (16, 728); zero on its own pixels."""
    row, column = np.divmod(np.arange(PIXELS), COLUMNS)
    distance = np.hypot(
        row[None, None] - row[pixels][..., None], column[None, None] - column[pixels][..., None]
    )
    kernel = np.divide(1.0, distance, out=np.zeros_like(distance), where=distance > 0).sum(axis=1)
    for contact, own in enumerate(pixels):
        kernel[contact, own] = 0.0
    return kernel


def _paint(
    potential: NDArray[np.float64], pixels: NDArray[np.intp], active: NDArray[np.bool_], value: float
) -> None:
    """Set the pixels of the active contacts (n, 16) to a constant, in place."""
    row, contact = np.nonzero(active)
    potential[row[:, None], pixels[contact]] = value


def _checked(configurations: ArrayLike) -> NDArray[np.int8]:
    given = np.asarray(configurations)
    if given.ndim != 2 or given.shape[1] != CONTACTS:
        raise DatasetError(f"configurations have shape {given.shape}, expected (n, {CONTACTS})")
    wrong = ~np.isin(given, (-1, 0, 1))
    if wrong.any():
        raise DatasetError(f"a contact polarity is {given[wrong][0]:g}, expected -1, 0 or 1")
    poles = (given < 0).any(axis=1) & (given > 0).any(axis=1)
    if not poles.all():
        raise DatasetError(f"configuration {int(np.argmin(poles))} has no cathode or no anode, expected both")
    return given.astype(np.int8)
