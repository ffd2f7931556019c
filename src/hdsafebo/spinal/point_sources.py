"""What a stimulation does to axons, roughly: point sources on the paddle, and nothing of the anatomy.

Each contact is a point source in a homogeneous medium, V = 1 / r up to a constant, and the current of a pole
is divided equally among its contacts. The activating function of an axon is the second derivative of the
potential along it (Rattay 1986, IEEE Trans Biomed Eng 33:974). On lines along the cord below the paddle its
root mean square is taken over stretches of a few millimetres.

Whoever places a paddle knows this much: where its contacts are, and that the cord lies a few millimetres
below. The finite-element model, its conductivities, the motor pools and the threshold are not used.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hdsafebo.spinal.configurations import current_shares
from hdsafebo.spinal.field_map import COLUMNS, ROWS, contact_pixels

DEPTHS_MM = (4.0, 8.0)  # below the contacts: the cord's dorsal surface and its middle
LINES_MM = (3.0, 7.0, 11.0)  # from the paddle's left edge; 7 is the midline of paddle and cord
STRETCHES = 14  # along the cord, 4 or 5 mm each
MARGIN_MM = 4  # beyond either end of the paddle


def unit_responses(polarity: NDArray[np.int8]) -> NDArray[np.float64]:
    """Root mean square of the activating function per line and stretch at 1 mA, up to a constant factor.

    Args:
        polarity: of each contact, -1 cathode, 0 off, +1 anode, shape (n, 16).

    Returns:
        1/mm^3, shape (n, 84): depths, then lines, then stretches from rostral to caudal.
    """
    shares = current_shares(polarity)
    z = np.arange(-MARGIN_MM, ROWS + MARGIN_MM + 1.0)
    ends = np.linspace(0, len(z), STRETCHES + 1).astype(int)
    responses = []
    for depth in DEPTHS_MM:
        for x in LINES_MM:
            squared = (shares @ _second_derivative(x, depth, z)) ** 2
            responses += [np.sqrt(squared[:, a:b].mean(axis=1)) for a, b in pairwise(ends)]
    return np.stack(responses, axis=1)


def _second_derivative(x: float, depth: float, z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Second derivative along z of 1 / r for each contact's centre, mm^-3, shape (16, len(z))."""
    row, column = (part.mean(axis=1) + 0.5 for part in np.divmod(contact_pixels(), COLUMNS))
    along = (z - row[:, None]) ** 2
    across = ((x - column) ** 2 + depth**2)[:, None]
    return np.asarray((2 * along - across) / (along + across) ** 2.5)
