"""The box that is searched, as a unit cube, and the space in which the kernel measures distances."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hdsafebo.errors import ProblemError
from hdsafebo.problem import floats
from hdsafebo.typing import FloatArray, Shaped


class SearchSpace:
    """A box of codes seen as the unit cube.

    Trust regions and candidates live in the unit cube, where every dimension has the same range. Dividing
    each dimension by its own width is not an isometry, so the kernel has inputs of its own: with `isotropic`
    all dimensions are divided by one number, the largest width, so that distances between codes are only
    scaled and Proposition 3 of the paper keeps its premise; without, the kernel sees the unit cube, which is
    right when the units of the dimensions have nothing to do with each other.

    Args:
        bounds: (2, d) lower and upper limits of the codes; a dimension of zero width stays fixed.
        isotropic: as above.
        land: (n, d) codes that are evaluated where (n, d) codes are proposed; None evaluates all as they are.

    Raises:
        ProblemError: the limits are no box, or all widths are zero.
    """

    def __init__(
        self,
        bounds: FloatArray,
        *,
        isotropic: bool,
        land: Callable[[FloatArray], FloatArray] | None = None,
    ) -> None:
        limits = floats(bounds, "bounds of the search space")
        if limits.ndim != 2 or limits.shape[0] != 2 or limits.shape[1] == 0:
            raise ProblemError(
                f"bounds of the search space have shape {limits.shape}; expected (2, d) with d >= 1"
            )
        if not np.isfinite(limits).all():
            bad = np.flatnonzero(~np.isfinite(limits).all(axis=0)).tolist()
            raise ProblemError(f"bounds of the search space are not finite in dimensions {bad[:10]}")
        width = limits[1] - limits[0]
        if (width < 0).any():
            raise ProblemError(
                "lower bound above upper bound of the search space in dimensions "
                f"{np.flatnonzero(width < 0).tolist()[:10]}"
            )
        if not (width > 0).any():
            raise ProblemError(
                f"the search space has zero width in all {len(width)} dimensions; expected one that varies"
            )
        self.bounds = limits
        self.lower = limits[0]
        self.width = width
        self.unit = np.where(width > 0, width, width.max())
        self.metric = self.unit / width.max() if isotropic else np.ones(len(width))
        self._land = land
        self._held: dict[int, float] = {}

    @property
    def dimension(self) -> int:
        """d."""
        return len(self.width)

    def to_unit(self, z: Shaped[FloatArray, "n d"]) -> Shaped[FloatArray, "n d"]:
        """(n, d) unit-cube coordinates of codes; codes outside the box lie outside the cube."""
        return (z - self.lower) / self.unit

    def to_code(self, u: Shaped[FloatArray, "n d"]) -> Shaped[FloatArray, "n d"]:
        """(n, d) codes of unit-cube coordinates, rounded into the box."""
        return np.asarray(np.clip(self.lower + u * self.width, self.lower, self.lower + self.width))

    def hold(self, dimensions: Sequence[int], codes: FloatArray) -> None:
        """Keep dimensions at the given codes in all points that are proposed from now on."""
        values = (codes - self.lower[list(dimensions)]) / self.unit[list(dimensions)]
        self._held = dict(zip(dimensions, values.tolist(), strict=True))

    def pinned(self, u: Shaped[FloatArray, "n d"]) -> Shaped[FloatArray, "n d"]:
        """(n, d) points of the unit cube where the given ones would be evaluated.

        They are at 0 in dimensions of zero width, at what is held in the dimensions that are, and landed.
        """
        if self._held:
            u = u.copy()
            u[:, list(self._held)] = list(self._held.values())
        if not (self.width > 0).all():
            u = np.where(self.width > 0, u, 0.0)
        return u if self._land is None else self.to_unit(self._land(self.to_code(u)))

    def kernel_inputs(self, u: Shaped[FloatArray, "n d"]) -> Shaped[FloatArray, "n d"]:
        """(n, d) what the kernel measures distances between."""
        return u * self.metric

    def from_kernel_inputs(self, k: Shaped[FloatArray, "n d"]) -> Shaped[FloatArray, "n d"]:
        """Inverse of `kernel_inputs`."""
        return k / self.metric
