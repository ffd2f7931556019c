"""The scale on which an outcome is modelled.

Gains differ between days and trials: they multiply. On a logarithmic scale they add, and the noise is as
large at the best trials as at all others (Box and Cox 1964).
"""

from __future__ import annotations

import numpy as np

from hdsafebo.typing import FloatArray


class OutcomeScale:
    """Outcomes as they are."""

    def modelled(self, outcome: FloatArray) -> FloatArray:
        """Outcomes as they are modelled; increasing."""
        return outcome

    def shown(self, mean: FloatArray, deviation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Median and, to first order, deviation in the outcomes' own units of what is modelled."""
        return mean, deviation


class LogScale(OutcomeScale):
    """log(offset + y), for outcomes that are not negative.

    Args:
        offset: positive; differences among outcomes far below it do not count.
    """

    def __init__(self, offset: float) -> None:
        self._offset = offset

    def modelled(self, outcome: FloatArray) -> FloatArray:
        """See `OutcomeScale`."""
        return np.asarray(np.log(self._offset + outcome))

    def shown(self, mean: FloatArray, deviation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `OutcomeScale`."""
        size = np.exp(mean)
        return size - self._offset, size * deviation
