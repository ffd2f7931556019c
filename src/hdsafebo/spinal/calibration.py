"""The activation threshold, fixed so that half of the dataset is safe.

The paper states neither its threshold nor its unit, only that "nearly half of the traversed parameters are
safe" at h = 0.05. The threshold is therefore a calibration constant, not a physiological finding: only
ratios of currents mean anything, and the share of safe rows is no result.

Muscle i of a configuration is activated beyond 1 - h when more than (1 - h) n_i of its n_i points exceed the
threshold T, that is when I * q_i > T, with q_i the activating function per mA that so many points exceed.
A row is safe when I * max_i q_i <= T, so the median of I * max_i q_i over all rows is the T that makes half
of them safe.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import DatasetError


def saturating_rank(points: int, safety_threshold: float) -> int:
    """Ascending rank (from 0) of the value q among `points` values, see the module's text."""
    most = int(np.floor((1 - safety_threshold) * points + 1e-9))
    return points - most - 1


def calibrate(saturation: NDArray[np.floating], currents: NDArray[np.floating]) -> float:
    """The threshold in mV/mm^2.

    Args:
        saturation: max_i q_i of every configuration, mV/mm^2 per mA, shape (configurations,).
        currents: mA, shape (levels,).

    Raises:
        DatasetError: more than half of the rows have no activation to speak of.
    """
    threshold = float(np.median(np.multiply.outer(saturation.astype(float), currents.astype(float))))
    if not (np.isfinite(threshold) and threshold > 0):
        raise DatasetError(
            f"the activation threshold calibrates to {threshold} mV/mm^2, expected a positive number"
        )
    return threshold
