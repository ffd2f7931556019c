"""Traversal of all configurations and currents: activation, selectivity and safety of 218,000 rows.

The activating functions of a chunk of configurations are one matrix product away from those of the unit
currents, so they are computed twice, for the calibration and for the activations, and never stored.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import AnatomyError
from hdsafebo.progress import track
from hdsafebo.spinal.activating_function import SIDES, ActivatingFunction
from hdsafebo.spinal.calibration import calibrate, saturating_rank
from hdsafebo.spinal.configurations import current_shares
from hdsafebo.spinal.muscles import MUSCLES, District, neighbours, safety, selectivity

Single = NDArray[np.float32]
Pools = list[tuple[int, int]]

_CHUNK = 200  # configurations whose activating functions are held at a time, per thread
_THREADS = 2


@dataclass(frozen=True)
class Traversal:
    """What every configuration does at every current.

    Attributes:
        polarity: shape (configurations, 16).
        currents: mA, shape (levels,).
        threshold: activating function that activates a point, mV/mm^2.
        mu, si: activation and selectivity, shape (configurations, levels, muscles, sides).
        g: safety, shape (configurations, levels).
    """

    polarity: NDArray[np.int8]
    currents: Single
    threshold: float
    mu: Single
    si: Single
    g: Single


def traverse(
    activating: ActivatingFunction,
    borders: Mapping[str, District],
    polarity: NDArray[np.int8],
    currents: NDArray[np.floating],
    safety_threshold: float,
    threshold: float | None = None,
) -> Traversal:
    """Activation, selectivity and safety of every configuration at every current.

    Args:
        activating: unit activating functions.
        borders: of the muscles' districts, mm.
        polarity: configurations, shape (n, 16).
        currents: mA, increasing, shape (levels,).
        safety_threshold: g from which a row is safe.
        threshold: activating function that activates a point, mV/mm^2; None calibrates it.

    Raises:
        AnatomyError: a district holds no sampled slice.
        DatasetError: the threshold cannot be calibrated.
    """
    currents = np.asarray(currents, dtype=np.float32)
    pools = _pools(activating, borders)
    if threshold is None:
        ranks = [saturating_rank(last - first, safety_threshold) for first, last in pools]
        saturation = _over_chunks(
            activating, polarity, lambda af: _saturation(af, pools, ranks), "Calibration"
        )
        threshold = calibrate(saturation, currents)
    needed = _round_down(threshold / currents.astype(float))
    shares = _over_chunks(activating, polarity, lambda af: _active_shares(af, pools, needed), "Traversal")
    mu = shares.reshape(len(polarity), len(currents), len(SIDES), len(MUSCLES)).swapaxes(2, 3)
    si = selectivity(mu, neighbours(borders))
    single = [np.ascontiguousarray(a, dtype=np.float32) for a in (mu, si, safety(mu))]
    return Traversal(polarity, currents, threshold, *single)


def _pools(activating: ActivatingFunction, borders: Mapping[str, District]) -> Pools:
    """First and last + 1 flat point of every pool, sides before muscles."""
    slices, points = len(activating.z), len(activating.points)
    pools = []
    for side in range(len(SIDES)):
        for muscle in MUSCLES:
            first, last = (int(i) for i in np.searchsorted(activating.z, borders[muscle]))
            if first == last:
                raise AnatomyError(
                    f"no sampled slice lies in the district of {muscle}: sample the cord more finely"
                )
            pools.append(((side * slices + first) * points, (side * slices + last) * points))
    return pools


def _over_chunks(
    activating: ActivatingFunction,
    polarity: NDArray[np.int8],
    measure: Callable[[Single], NDArray],
    description: str,
) -> NDArray:
    """Measure absolute activating functions per mA, (chunk, sides * slices * points), chunk by chunk."""
    unit = activating.unit.reshape(len(activating.unit), -1).astype(np.float32)
    shares = current_shares(polarity).astype(np.float32)

    def run(first: int) -> NDArray:
        return measure(np.abs(shares[first : first + _CHUNK] @ unit))

    starts = range(0, len(shares), _CHUNK)
    with ThreadPoolExecutor(_THREADS) as threads:
        return np.concatenate(list(track(threads.map(run, starts), description, total=len(starts))))


def _saturation(af: Single, pools: Pools, ranks: list[int]) -> Single:
    """Largest over the pools of the pool's value of the given ascending rank, shape (chunk,)."""
    values = [
        np.partition(af[:, first:last], rank, axis=1)[:, rank]
        for (first, last), rank in zip(pools, ranks, strict=True)
    ]
    return np.max(values, axis=0)


def _active_shares(af: Single, pools: Pools, needed: Single) -> NDArray[np.float64]:
    """Share of each pool's points with af > needed, shape (chunk, levels, pools)."""
    shares = np.empty((len(af), len(needed), len(pools)))
    for level, least in enumerate(needed):
        active = af > least
        for pool, (first, last) in enumerate(pools):
            shares[:, level, pool] = np.count_nonzero(active[:, first:last], axis=1) / (last - first)
    return shares


def _round_down(values: NDArray[np.float64]) -> Single:
    """The largest single-precision numbers that are not above `values`: af > value stays exact."""
    single = values.astype(np.float32)
    return np.where(single > values, np.nextafter(single, np.float32(0)), single)
