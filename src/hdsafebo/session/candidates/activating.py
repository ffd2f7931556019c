"""What a stimulation does to axons, roughly: the kernel's view of stimulations.

The activating function of an axon is the second derivative of the extracellular potential along it (Rattay
1986, IEEE Trans Biomed Eng 33:974). Here each contact is a point source in a homogeneous medium, V = 1 / r up
to a constant, the current divided equally within each pole. On lines along the cord below the paddle the root
mean square of the activating function is taken over stretches of the cord, and its log is a feature:

    features = log(floor + I * rms of |d2V/dz2|)

Doubling the current shifts all features alike, and what is stimulated where shows in their differences. No
anatomy, no conductivity: it need not be right, only similar for stimulations with similar effects.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from hdsafebo.session.measuring.stimulator import Polarity
from hdsafebo.spinal.field_map import COLUMNS, ROWS, contact_pixels
from hdsafebo.typing import FloatArray

DEPTH_MM = 10.0  # of the lines below the contacts: what is measured is likelier than with 4, 6 or 8 mm
LINES_MM = (-1.5, 3.5, 8.5)  # across: the midline of the paddle, and the roots to both sides of it
STRETCHES = 13  # along the cord
_MARGIN_MM = 4  # beyond either end of the paddle
_FLOOR = 1.3e-6  # mA / mm3: differences among responses this small do not count
_SCALE = 5.0  # brings distances between features to the order of one
FEATURES = len(LINES_MM) * STRETCHES


def activating_features(polarity: Polarity, current_ma: FloatArray) -> FloatArray:
    """(n, 39) features of polarities (n, 16) at currents (n,)."""
    return scale_by_current(unit_activation(polarity), current_ma)


def scale_by_current(unit: FloatArray, current_ma: FloatArray) -> FloatArray:
    """Features of unit activations (n, 39) at currents (n,)."""
    return np.asarray(np.log(_FLOOR + current_ma[:, None] * unit) / _SCALE)


def unit_activation(polarity: Polarity) -> FloatArray:
    """(n, 39) rms of the activating function per line and stretch at 1 mA, up to a constant factor."""
    cathodes, anodes = (polarity < 0).astype(float), (polarity > 0).astype(float)
    source = anodes / anodes.sum(axis=1, keepdims=True) - cathodes / cathodes.sum(axis=1, keepdims=True)
    z = np.arange(-_MARGIN_MM, ROWS + _MARGIN_MM + 1.0)
    ends = np.linspace(0, len(z), STRETCHES + 1).astype(int)
    columns = []
    for x in LINES_MM:
        squared = (source @ _second_derivative(x, z)) ** 2
        columns += [np.sqrt(squared[:, a:b].mean(axis=1)) for a, b in pairwise(ends)]
    return np.stack(columns, axis=1)


def _second_derivative(x: float, z: FloatArray) -> FloatArray:
    """(16, len(z)) second derivative along z of 1 / r for each contact, on the line at x."""
    row, column = (part.mean(axis=1) for part in np.divmod(contact_pixels(), COLUMNS))
    along = (z[None] - row[:, None]) ** 2
    across = (x - column[:, None]) ** 2 + DEPTH_MM**2
    return np.asarray((2.0 * along - across) / (along + across) ** 2.5)
