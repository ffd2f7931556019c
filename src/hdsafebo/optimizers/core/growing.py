"""An array that grows at its end: appending rows copies them, and hardly ever those that were there."""

from __future__ import annotations

import numpy as np

from hdsafebo.typing import FloatArray


class GrowingRows:
    """Room for rows to come behind those that are known; room that is not used yet takes no memory."""

    def __init__(self) -> None:
        self._room = np.empty((0, 0))

    def extended(self, known: FloatArray, more: FloatArray) -> FloatArray:
        """(n + k, d) the (n, d) known rows followed by k more.

        Args:
            known: what the last call gave, or fewer rows of it (more rows behind them are then given up);
                any other array is copied.
            more: (k, d) rows.
        """
        n, total = len(known), len(known) + len(more)
        if known.base is not self._room or total > len(self._room):
            room = np.empty((max(total, 2 * n), more.shape[1]))
            room[:n] = known
            self._room = room
        self._room[n:total] = more
        return self._room[:total]
