"""Warps of outcomes: what a Gaussian process is asked to explain may be a compressed version of the values.

Constraints of engineering problems span orders of magnitude, and all that matters is how they cross their
threshold. v -> asinh((v - centre) / scale) is linear within a scale of the centre and logarithmic beyond; its
Jacobian makes likelihoods under different warps comparable (Snelson, Rasmussen and Ghahramani, Warped
Gaussian processes, NeurIPS 2003).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdsafebo.typing import FloatArray

_QUANTILES = (0.1, 0.3, 0.6, 0.9)
"""Of the distances to the centre that are tried as scales: from nearly a logarithm to nearly linear."""
_LEAST_VALUES = 4
_LARGEST = 1e140
"""Values beyond count as this one: squares and variances stay finite numbers."""


@dataclass(frozen=True)
class Warp:
    """An increasing map of outcomes.

    Attributes:
        centre: value that becomes 0.
        scale: distance from the centre where the map turns from linear to logarithmic; infinity leaves
            differences as they are.
    """

    centre: float
    scale: float = np.inf

    def apply(self, y: FloatArray) -> FloatArray:
        """Warped values."""
        v = np.clip(y, -_LARGEST, _LARGEST) - self.centre
        return v if np.isinf(self.scale) else np.asarray(np.arcsinh(v / self.scale))

    def restore(self, t: FloatArray) -> FloatArray:
        """Inverse of `apply`; beyond the largest value that one."""
        if np.isinf(self.scale):
            return self.centre + t
        limit = np.arcsinh(_LARGEST / self.scale)
        return np.asarray(self.centre + self.scale * np.sinh(np.clip(t, -limit, limit)))

    def log_jacobian(self, y: FloatArray) -> float:
        """Logarithm of the derivative, summed over the (n,) values."""
        if np.isinf(self.scale):
            return 0.0
        v = (np.clip(y, -_LARGEST, _LARGEST) - self.centre) / self.scale
        return float(-np.log(self.scale) * len(y) - np.log(np.hypot(1.0, v)).sum())


def warp_scales(y: FloatArray, centre: float) -> tuple[float, ...]:
    """Scales to choose from, given the (n,) first values of a function; none when there are few values.

    They stay what the first data made them: taken from all data they would shrink with every trial near the
    threshold, until the warp is a step.
    """
    distance = np.abs(np.clip(y, -_LARGEST, _LARGEST) - centre)
    distance = distance[distance > 0]
    if len(distance) < _LEAST_VALUES:
        return ()
    return tuple(float(q) for q in np.quantile(distance, _QUANTILES))
