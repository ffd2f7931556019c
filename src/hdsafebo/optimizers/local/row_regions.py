"""Trust regions on a finite candidate set: the rows nearest to each of several centres.

Several regions at a time find an optimum that is isolated from the first one (TuRBO-m: Eriksson et al.,
Scalable global optimization via local Bayesian optimization, NeurIPS 2019).
"""

from __future__ import annotations

import numpy as np

from hdsafebo.gp.kernel import fast_distances
from hdsafebo.typing import FloatArray, IntArray


def separate_centres(best: FloatArray, others: FloatArray, apart: float, most: int) -> FloatArray:
    """(k, p) the best point, then those of the others, in their order, that lie apart from all before.

    Args:
        best: (1, p) kernel inputs of the first centre.
        others: (n, p) kernel inputs of the others, the better ones first.
        apart: least distance between two centres.
        most: largest number of centres.
    """
    centres = best
    for candidate in others:
        if len(centres) == most:
            break
        if fast_distances(candidate[None], centres).min() >= apart:
            centres = np.concatenate([centres, candidate[None]])
    return centres


def rows_near(
    features: FloatArray,
    taken: IntArray,
    centres: FloatArray,
    size: int,
    share: int,
    rng: np.random.Generator,
) -> list[IntArray]:
    """The rows of each region.

    Args:
        features: (n, p) kernel inputs of all candidates.
        taken: rows that cannot be chosen any more.
        centres: (k, p) kernel inputs of the regions' centres.
        size: of a region, in rows that are left.
        share: a larger region is thinned at random to so many rows.
        rng: source of randomness.
    """
    distances = fast_distances(centres, features)
    distances[:, taken] = np.inf
    near = [np.argpartition(row, size - 1)[:size] for row in distances]
    return [rows if size <= share else rng.choice(rows, share, replace=False) for rows in near]
