"""Candidates of a search: space-filling points, and points of a box around a centre."""

from __future__ import annotations

import numpy as np

from hdsafebo.typing import FloatArray, Shaped

_PERTURBED = 20
"""How many coordinates of the centre a candidate changes on average (TuRBO, supplement)."""


def sobol_points(n: int, dimension: int, rng: np.random.Generator) -> Shaped[FloatArray, "n d"]:
    """(n, d) points of a scrambled Sobol sequence in the unit cube."""
    from scipy.stats import qmc  # half a second of import

    # A seed is drawn, since SciPy would spawn a child of `rng`, which saving its state would not remember.
    sequence = qmc.Sobol(dimension, scramble=True, rng=int(rng.integers(2**63)))
    first = 1 << (n.bit_length() - 1)  # SciPy warns when a sequence does not start with a power of two
    points = sequence.random(first)
    return points if first == n else np.concatenate([points, sequence.random(n - first)])


def box_candidates(
    centre: Shaped[FloatArray, " d"],
    half_sides: Shaped[FloatArray, " *h"],
    count: int,
    rng: np.random.Generator,
) -> Shaped[FloatArray, "c d"]:
    """(count, d) points of the box around a point of the unit cube.

    Scrambled Sobol points, of which each keeps the centre's value in all but some 20 coordinates: in high
    dimension a change of all of them leaves little of what made the centre good.

    Args:
        centre: (d,) in the unit cube.
        half_sides: (d,), or one for all.
        count: number of points.
        rng: source of randomness.
    """
    d = len(centre)
    lower, upper = np.clip(centre - half_sides, 0.0, 1.0), np.clip(centre + half_sides, 0.0, 1.0)
    points = lower + (upper - lower) * sobol_points(count, d, rng)
    if d <= _PERTURBED:
        return points
    change = rng.random((count, d)) <= _PERTURBED / d
    none = np.flatnonzero(~change.any(axis=1))
    change[none, rng.integers(d, size=len(none))] = True
    return np.where(change, points, centre)
