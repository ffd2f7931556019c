"""Exact nearest unevaluated stimulation of a field map, without the table of 218,000 maps.

A decoded map is no real stimulation; it takes the value of the nearest unevaluated row of the dataset
(paper, stimulation task). Row i*K + k is configuration i at the k-th of K currents, with map
1 + c_k p_i, p_i the unit potential and c_k the current over 5 mA. For a query 1 + r and an upper bound u of
r . p_i / |p_i|, every row of configuration i obeys

    |r - c_k p_i|^2 >= |r|^2 + min_s (s^2 - 2 s u),   s in [c_1 |p_i|, c_K |p_i|],

with the minimum at u clipped to the interval. The upper bound comes from a few principal directions: with P
the projection on them, Cauchy-Schwarz gives

    r . p <= Pr . Pp + |r - Pr| |p - Pp|,

an inner product of vectors that are one longer, so one small product in single precision serves all
configurations. Only those whose bound reaches the best exact distance found so far are looked at in double
precision, so the answer is the exact one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdsafebo.errors import DatasetError
from hdsafebo.spinal.field_map import BACKGROUND, REFERENCE_CURRENT_MA, field_maps

PRINCIPAL_DIRECTIONS = 48  # hold all but 0.4% of the unit potentials' norm
FIRST_LOOK = 8  # configurations whose exact distances set the threshold
BATCH = 256  # queries per product in nearest_rows
# |rounding error| of a float32 inner product of length n is below n u |a| |b|, u = 2^-24; the casts of both
# factors add 2 u (Higham, Accuracy and Stability of Numerical Algorithms, 2002, section 3.1). Doubled.
_SINGLE_ROUNDING = 2.0 * (PRINCIPAL_DIRECTIONS + 3) * 2.0**-24
_DOUBLE_ROUNDING = 1e-12  # of squared distances, relative to |r|^2: 728 terms at 2^-53, with room

Rows = NDArray[np.intp]
Distances = NDArray[np.float64]


class NearestMap:
    """Exact nearest rows among all pairs of a unit potential and a current.

    Args:
        unit_maps: unit potentials of the configurations, shape (n, pixels), finite, none zero.
        currents: the K currents in mA, positive and increasing; row = configuration * K + current index.

    Raises:
        DatasetError: wrong shapes, values that are not finite, a zero potential, currents not increasing.
    """

    def __init__(self, unit_maps: ArrayLike, currents: ArrayLike) -> None:
        self._unit = np.ascontiguousarray(unit_maps, dtype=float)
        self._strength = np.asarray(currents, dtype=float) / REFERENCE_CURRENT_MA
        _check(self._unit, self._strength)
        self._square = np.einsum("ij,ij->i", self._unit, self._unit)
        self._basis = _principal_directions(self._unit)
        self._size = np.sqrt(self._square)
        self._direction = _augmented(self._unit / self._size[:, None], self._basis).astype(np.float32)

    def __len__(self) -> int:
        """Number of rows, configurations times currents."""
        return len(self._unit) * len(self._strength)

    def maps(self, rows: ArrayLike) -> NDArray[np.float64]:
        """Field maps (n, pixels) of rows (n,); DatasetError if a row is out of range."""
        wanted = np.asarray(rows, dtype=np.intp)
        self._check_rows(wanted)
        configuration, current = np.divmod(wanted, len(self._strength))
        return field_maps(self._unit[configuration], self._strength[current] * REFERENCE_CURRENT_MA)

    def query(
        self, maps: ArrayLike, evaluated: ArrayLike | None = None, *, exclude_within_batch: bool = True
    ) -> tuple[Rows, Distances]:
        """Nearest unevaluated row of each map, in order.

        Args:
            maps: field maps, shape (b, pixels), finite.
            evaluated: rows that may not be returned: row numbers (m,), or a mask over all rows.
            exclude_within_batch: return no row twice.

        Returns:
            Rows (b,) and Euclidean distances (b,); of equally near rows the first.

        Raises:
            DatasetError: wrong shape, values that are not finite, rows out of range, or no row is left.
        """
        offset = self._offsets(maps)
        done = self._mask(evaluated)
        rows, distances = np.empty(len(offset), dtype=np.intp), np.empty(len(offset))
        for b, (r, bound) in enumerate(self._bounds(offset)):
            rows[b], distances[b] = self._nearest(r, bound, done)
            if exclude_within_batch:
                done.flat[rows[b]] = True
        return rows, distances

    def nearest_rows(self, maps: ArrayLike) -> tuple[Rows, Distances]:
        """Nearest row of each map among all rows: `query` with nothing excluded."""
        return self.query(maps, exclude_within_batch=False)

    def _offsets(self, maps: ArrayLike) -> NDArray[np.float64]:
        given = np.asarray(maps, dtype=float)
        if given.ndim != 2 or given.shape[1] != self._unit.shape[1]:
            raise DatasetError(f"maps have shape {given.shape}, expected (n, {self._unit.shape[1]})")
        if not np.isfinite(given).all():
            raise DatasetError("maps hold NaN or infinite pixels, expected finite numbers")
        return given - BACKGROUND

    def _mask(self, evaluated: ArrayLike | None) -> NDArray[np.bool_]:
        """Own mask of rows, shape (n, K), True where evaluated."""
        mask = np.zeros((len(self._unit), len(self._strength)), dtype=bool)
        if evaluated is None:
            return mask
        given = np.asarray(evaluated)
        if given.dtype == bool:
            if given.size != mask.size:
                raise DatasetError(f"evaluated is a mask of {given.size} rows, expected {mask.size}")
            return given.reshape(mask.shape).copy()
        if given.size and given.dtype.kind not in "iu":
            raise DatasetError(f"evaluated has dtype {given.dtype}, expected row numbers or a mask")
        rows = given.astype(np.intp)
        self._check_rows(rows)
        mask.flat[rows] = True
        return mask

    def _check_rows(self, rows: Rows) -> None:
        if rows.size and (rows.min() < 0 or rows.max() >= len(self)):
            found = f"{rows.min()} to {rows.max()}"
            raise DatasetError(f"rows reach from {found}, expected 0 to {len(self) - 1}")

    def _bounds(
        self, offset: NDArray[np.float64]
    ) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float32]]]:
        """Each query's offset r (pixels,) with an upper bound of r . p_i / |p_i|, shape (n,)."""
        for start in range(0, len(offset), BATCH):
            block = offset[start : start + BATCH]
            product = _augmented(block, self._basis).astype(np.float32) @ self._direction.T
            yield from zip(block, product, strict=True)

    def _nearest(
        self, r: NDArray[np.float64], bound: NDArray[np.float32], done: NDArray[np.bool_]
    ) -> tuple[int, float]:
        """Row and distance of the nearest row that is not done."""
        square, size = float(r @ r), self._size
        upper = bound + _SINGLE_ROUNDING * float(np.sqrt(square))
        multiple = np.clip(upper, self._strength[0] * size, self._strength[-1] * size)
        lower = multiple * (multiple - 2.0 * upper) + square
        threshold = self._exact_of_most_promising(r, lower, done) + _DOUBLE_ROUNDING * square
        near = np.flatnonzero(lower <= threshold)
        row, best = self._exact(r, near, done)
        return row, float(np.sqrt(max(0.0, best)))

    def _exact_of_most_promising(
        self, r: NDArray[np.float64], lower: NDArray[np.float64], done: NDArray[np.bool_]
    ) -> float:
        """Least squared distance among the configurations of least bound; more of them while all are done."""
        look = min(FIRST_LOOK, len(lower))
        best = self._exact(r, np.argpartition(lower, look - 1)[:look], done)[1]
        while not np.isfinite(best):
            if look == len(lower):
                raise DatasetError(f"all {done.size} rows are evaluated, no nearest one is left")
            look = min(8 * look, len(lower))
            best = self._exact(r, np.argpartition(lower, look - 1)[:look], done)[1]
        return best

    def _exact(
        self, r: NDArray[np.float64], configurations: NDArray[np.intp], done: NDArray[np.bool_]
    ) -> tuple[int, float]:
        """Nearest row that is not done among some configurations, and its squared distance (inf if none)."""
        c = self._strength
        product = self._unit[configurations] @ r
        square = c * (c * self._square[configurations, None] - 2.0 * product[:, None]) + r @ r
        square[done[configurations]] = np.inf
        best = int(np.argmin(square))
        configuration, current = divmod(best, len(c))
        return int(configurations[configuration]) * len(c) + current, float(square.flat[best])


def _principal_directions(unit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Leading right singular vectors of the unit potentials, shape (pixels, at most 48)."""
    _, vectors = np.linalg.eigh(unit.T @ unit)
    return np.ascontiguousarray(vectors[:, ::-1][:, :PRINCIPAL_DIRECTIONS])


def _augmented(vectors: NDArray[np.float64], basis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Projections on the basis followed by the norm of what it leaves out, shape (n, directions + 1)."""
    projected = vectors @ basis
    rest = np.einsum("ij,ij->i", vectors, vectors) - np.einsum("ij,ij->i", projected, projected)
    return np.column_stack([projected, np.sqrt(np.maximum(rest, 0.0))])


def _check(unit: NDArray[np.float64], strength: NDArray[np.float64]) -> None:
    if unit.ndim != 2 or not unit.size:
        raise DatasetError(f"unit_maps have shape {unit.shape}, expected (n, pixels)")
    if not np.isfinite(unit).all():
        raise DatasetError("unit_maps hold NaN or infinite pixels, expected finite numbers")
    if not unit.any(axis=1).all():
        raise DatasetError("a unit map is zero everywhere, expected a potential")
    increasing = strength.ndim == 1 and strength.size > 0 and np.isfinite(strength).all()
    if not increasing or strength[0] <= 0 or (np.diff(strength) <= 0).any():
        raise DatasetError(
            f"currents are {strength * REFERENCE_CURRENT_MA} mA, expected positive, increasing, finite ones"
        )
