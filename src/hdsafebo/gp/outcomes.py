"""Standardisation of what is modelled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from hdsafebo.typing import FloatArray, Shaped

_OUTLIER = 20.0
"""Scales beyond which values are drawn in: far outside what a Gaussian process can be asked to explain."""
_TAIL = 0.05
"""Share cut off at each end before centre and scale are taken: one absurd value in twenty changes neither."""
_LARGEST = 1e140
"""Values beyond count as this one: squares and variances stay finite numbers."""


@dataclass(frozen=True)
class Outcomes:
    """Standardisation of outcomes, with extreme values drawn in.

    Centre is the mean and scale the standard deviation of the central nine tenths of the values, so that one
    absurd value (1e12) does not flatten all others. Beyond 20 scales values grow logarithmically: strictly
    increasing, so that orders and thresholds keep their meaning. Constant outcomes have scale 1.
    """

    centre: float
    scale: float

    @classmethod
    def of(cls, y: Shaped[FloatArray, " n"]) -> Outcomes:
        """Standardisation of the (n,) values."""
        y = np.clip(y, -_LARGEST, _LARGEST)
        # Of one or two values none may be cut; of three, the median is left.
        tail = int(np.ceil(_TAIL * len(y))) if len(y) > 2 else 0
        central = np.sort(y)[tail : len(y) - tail]
        # Where the central values are all equal (a plateau), the scale of all of them is used.
        for values in (central, y):
            centre, scale = float(np.mean(values)), float(np.std(values))
            if scale > 1e-12 * max(abs(centre), 1e-280):
                return cls(centre, scale)
        return cls(float(np.mean(central)), 1.0)

    def standardise(self, y: Shaped[FloatArray, " *s"]) -> Shaped[FloatArray, " *s"]:
        """Standardised values."""
        v = (np.clip(y, -_LARGEST, _LARGEST) - self.centre) / self.scale
        far = np.abs(v) > _OUTLIER
        if np.any(far):
            drawn = np.sign(v) * (_OUTLIER + np.log1p(np.abs(v) - _OUTLIER, where=far, out=np.zeros_like(v)))
            v = np.where(far, drawn, v)
        return np.asarray(v)

    def restore(self, v: Shaped[FloatArray, " *s"]) -> Shaped[FloatArray, " *s"]:
        """Values in the outcomes' units (drawn-in values stay drawn in)."""
        return self.centre + self.scale * v


def normal_scores(y: Shaped[FloatArray, " n"]) -> Shaped[FloatArray, " n"]:
    """(n,) standard normal quantiles at the ranks of the (n,) values; equal values share a rank.

    Modelled in place of the values they spread out what is crowded, such as the best of them, and have the
    same maximiser (Gaussian copula, as in SCBO: Eriksson and Poloczek, AISTATS 2021, section 3.2).
    """
    from scipy.stats import rankdata  # half a second of import

    return np.asarray(ndtri((rankdata(y) - 0.5) / len(y)))
