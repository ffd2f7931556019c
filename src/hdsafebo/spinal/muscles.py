"""Muscle groups: where their motor pools lie, how far they are activated, how selectively, how safely.

Paper, appendix on the neuromuscular model: mu_i is the share of the pool's volume whose activating function
exceeds a threshold, SI_i = mu_i - mean of mu_j over the pools adjacent to i, and g = 1 - max_i mu_i. Both
sides of the body are kept apart: neighbours are sought on the same side, and the maximum runs over all
twelve pools, because a strong twitch is unwanted in either leg.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import AnatomyError, UnknownNameError
from hdsafebo.spinal.geometry.anatomy import DISTRICTS, Anatomy

MUSCLES = tuple(DISTRICTS)
District = tuple[float, float]


def districts(anatomy: Anatomy, places: Mapping[str, Sequence[str]] | None = None) -> dict[str, District]:
    """Rostral and caudal border of each muscle's pool, mm.

    Args:
        anatomy: gives the segments' places.
        places: muscle -> (first, last) segment, "mid-L4" for a segment's middle; replaces the table's.

    Raises:
        UnknownNameError: no such muscle or segment.
        AnatomyError: a district ends before it begins.
    """
    places = dict(places or {})
    for muscle in places:
        if muscle not in MUSCLES:
            raise UnknownNameError("muscle", muscle, MUSCLES)
    found = {}
    for muscle, (first, last) in (dict(DISTRICTS) | {m: (p[0], p[1]) for m, p in places.items()}).items():
        low, high = anatomy.place(first, end=False), anatomy.place(last, end=True)
        if low >= high:
            raise AnatomyError(
                f"the district of {muscle} runs from {first} ({low:g} mm) to {last} ({high:g} mm), "
                "expected a caudal end below its rostral end"
            )
        found[muscle] = (low, high)
    return found


def neighbours(borders: Mapping[str, District]) -> dict[str, tuple[str, ...]]:
    """The adjacent pools of each muscle: those whose districts share a stretch of the cord.

    Raises:
        AnatomyError: a muscle has no neighbour, so that its selectivity is not defined.
    """
    found = {
        m: tuple(n for n, (a, b) in borders.items() if n != m and a < high and low < b)
        for m, (low, high) in borders.items()
    }
    for muscle, adjacent in found.items():
        if not adjacent:
            raise AnatomyError(
                f"the district of {muscle} overlaps with no other, so its selectivity is not defined"
            )
    return found


def selectivity(mu: NDArray[np.floating], adjacent: Mapping[str, Sequence[str]]) -> NDArray[np.floating]:
    """Selectivity indices, in [-1, 1].

    Args:
        mu: activations in [0, 1], shape (..., muscles, sides), muscles in the order of `MUSCLES`.
        adjacent: see `neighbours`.
    """
    mean = np.zeros((len(MUSCLES), len(MUSCLES)), dtype=mu.dtype)
    for i, muscle in enumerate(MUSCLES):
        mean[i, [MUSCLES.index(n) for n in adjacent[muscle]]] = 1 / len(adjacent[muscle])
    return mu - np.einsum("ij,...js->...is", mean, mu)


def safety(mu: NDArray[np.floating]) -> NDArray[np.floating]:
    """g = 1 - the largest activation of any muscle on any side; mu has shape (..., muscles, sides)."""
    return 1 - mu.max(axis=(-2, -1))
