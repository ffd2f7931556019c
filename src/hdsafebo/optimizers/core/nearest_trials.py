"""A surrogate of bounded cost: which trials it is fitted to when there are more than it may have.

An exact Gaussian process of n trials costs n^3 operations, the limit that the paper names. A trust region
needs what is known near its centre, so the trials nearest to the best feasible one are kept.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdsafebo.gp.kernel import exact_distances
from hdsafebo.optimizers.core.ledger import Ledger
from hdsafebo.typing import FloatArray, IntArray


def rows_near_best(ledger: Ledger, inputs_of: Callable[[IntArray], FloatArray], most: int | None) -> IntArray:
    """Rows of the completed trials that a surrogate is fitted to, in order of their ids.

    Args:
        ledger: all trials.
        inputs_of: gives the (k, p) kernel inputs of rows: what the kernel measures distances between.
        most: number of trials kept, those nearest to the best feasible trial (without one, to that of the
            least violation), which is always kept; of equally distant trials the older. None keeps all.
    """
    rows = np.flatnonzero(ledger.trials.completed)
    if most is None or len(rows) <= most:
        return rows
    best = ledger.best_row(ledger.feasible)
    centre = ledger.least_violation_row() if best is None else best
    inputs = inputs_of(rows)
    distance = exact_distances(inputs[rows == centre], inputs)[0]
    distance[rows == centre] = -1.0  # before its repetitions
    return np.sort(rows[np.argsort(distance, kind="stable")[:most]])
