"""The contact configurations of the stimulation dataset and the currents they split.

One cathode with one to three anodes, or two cathodes with one or two anodes:
16 * (15 + 105 + 455) + 120 * (14 + 91) = 21,800 (paper, stimulation task).
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

CONTACTS = 16
PATTERNS = ((1, 1), (1, 2), (1, 3), (2, 1), (2, 2))  # (cathodes, anodes)
CONFIGURATIONS = 21_800


def enumerate_configurations() -> NDArray[np.int8]:
    """Polarity of each contact, -1 cathode, 0 off, +1 anode, shape (21800, 16).

    The order is that of `PATTERNS`, then lexicographic in the cathodes, then in the anodes.
    """
    rows = []
    for cathodes, anodes in PATTERNS:
        for negative in combinations(range(CONTACTS), cathodes):
            rest = [c for c in range(CONTACTS) if c not in negative]
            for positive in combinations(rest, anodes):
                row = np.zeros(CONTACTS, dtype=np.int8)
                row[list(negative)] = -1
                row[list(positive)] = 1
                rows.append(row)
    return np.array(rows)


def current_shares(polarity: NDArray[np.int8]) -> NDArray[np.float64]:
    """Share of the stimulation current through each contact, shape (n, 16).

    Cathodes carry -1 and anodes +1 in all, in equal parts, so the currents of a configuration add up to zero.
    """
    positive, negative = polarity > 0, polarity < 0
    return positive / positive.sum(axis=1, keepdims=True) - negative / negative.sum(axis=1, keepdims=True)
