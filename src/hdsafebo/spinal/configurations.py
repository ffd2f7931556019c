"""The contact configurations of the stimulation set (paper, stimulation task).

One cathode with one to three anodes, then two cathodes with one or two anodes, among 16 contacts:
16 (15 + 105 + 455) + 120 (14 + 91) = 21,800 configurations.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

CONTACTS = 16
ANODES_OF = {1: (1, 2, 3), 2: (1, 2)}  # numbers of anodes, by the number of cathodes
CONFIGURATIONS = 21_800


def configurations() -> NDArray[np.int8]:
    """Polarity of each contact, -1 cathode, 0 off, +1 anode, shape (21800, 16).

    Ordered by the number of cathodes, the cathodes, the number of anodes, and the anodes.
    """
    polarity = np.zeros((CONFIGURATIONS, CONTACTS), dtype=np.int8)
    row = 0
    for n_cathodes, anode_numbers in ANODES_OF.items():
        for cathodes in combinations(range(CONTACTS), n_cathodes):
            free = [contact for contact in range(CONTACTS) if contact not in cathodes]
            for n_anodes in anode_numbers:
                for anodes in combinations(free, n_anodes):
                    polarity[row, cathodes] = -1
                    polarity[row, anodes] = 1
                    row += 1
    return polarity
