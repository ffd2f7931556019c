"""Exact potential in a layered, transversely isotropic cylinder: what the finite elements are held against.

Concentric layers with conductivity sigma_r across and sigma_z along the axis; the flat ends z = 0 and z = L
are insulated, the mantle r = R is at zero potential, and a patch of an interface r = a injects a current of
even density. Separation of variables gives

    V = sum_n sum_m [A I_m(q r) + B K_m(q r)] cos(m theta) cos(k z)
    with k = n pi / L and q = k sqrt(sigma_z / sigma_r),

with continuous potential and, but for the source, continuous radial current at every interface
(Abramowitz & Stegun 1964, chapter 9, for the modified Bessel functions).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ive, kve

Array = NDArray[np.float64]

_UNDERFLOW = 1e-280


@dataclass(frozen=True)
class LayeredCylinder:
    """A cylinder and the patch that injects 1 mA into it; lengths in mm, conductivities in S/m.

    Attributes:
        radii: outer radius of each layer, innermost first.
        across, along: conductivity of each layer.
        length: L.
        source: layer on whose outer face the patch lies.
        centre: z of the patch's middle; its theta is 0.
        half_length, half_arc: of the patch, along z and along the circle.
    """

    radii: tuple[float, ...] = (4.5, 8.0, 8.3, 12.0)
    across: tuple[float, ...] = (0.083, 1.7, 0.03, 0.04)
    along: tuple[float, ...] = (0.6, 1.7, 0.03, 0.04)
    length: float = 100.0
    source: int = 2
    centre: float = 50.0
    half_length: float = 1.5
    half_arc: float = 0.5

    def potential(
        self, r: ArrayLike, theta: ArrayLike, z: ArrayLike, *, orders: int = 25, harmonics: int = 200
    ) -> tuple[Array, Array]:
        """Potential and its second derivative along z at points of the innermost layer.

        Args:
            r, theta, z: mm, rad, mm; broadcast against each other.
            orders: number of m, from 0.
            harmonics: number of n, from 0.

        Returns:
            V in volts and d2V/dz2 in V/mm^2, of the broadcast shape.
        """
        r, theta, z = np.broadcast_arrays(*(np.asarray(c, dtype=float) for c in (r, theta, z)))
        radius, same = np.unique(r, return_inverse=True)
        k: Array = np.arange(harmonics, dtype=np.float64) * (np.pi / self.length)
        waves = np.cos(k[:, None] * z.ravel()) * self._along_axis(k)[:, None]
        potential, curvature = np.zeros(r.size), np.zeros(r.size)
        for m in range(orders):
            amplitude = self._amplitudes(m, k) * self._around(m)
            radial = _growing(m, self._wave_number(k, 0)[:, None], self.radii[0], radius)[0][:, same.ravel()]
            terms = amplitude[:, None] * radial * waves * np.cos(m * theta.ravel())
            potential += terms.sum(axis=0)
            curvature -= (k[:, None] ** 2 * terms).sum(axis=0)
        return potential.reshape(r.shape), curvature.reshape(r.shape)

    def _wave_number(self, k: Array, layer: int) -> Array:
        return k * float(np.sqrt(self.along[layer] / self.across[layer]))

    def _along_axis(self, k: Array) -> Array:
        """Fourier coefficients of the patch along z, for unit total current."""
        norm = np.where(k == 0, 1.0, 2.0) / self.length
        return np.asarray(norm * np.cos(k * self.centre) * np.sinc(k * self.half_length / np.pi))

    def _around(self, m: int) -> float:
        """Fourier coefficient of the patch around the axis, for unit total current, per mm of the circle."""
        half_angle = self.half_arc / self.radii[self.source]
        norm = (1.0 if m == 0 else 2.0) / (2 * np.pi * self.radii[self.source])
        return float(norm * np.sinc(m * half_angle / np.pi))

    def _amplitudes(self, m: int, k: Array) -> Array:
        """Coefficient of the innermost layer's solution for a unit source density, shape (len(k),)."""
        layers = len(self.radii)
        size = 2 * layers - 1  # A of layer 0, then A and B of each further layer
        system, load = np.zeros((len(k), size, size)), np.zeros((len(k), size))
        for j, radius in enumerate(self.radii):
            inner = self._solutions(m, k, j, radius)
            if j == layers - 1:
                for column, (value, _) in inner:
                    system[:, size - 1, column] = value
                continue
            for sign, sigma, solutions in (
                (1.0, self.across[j], inner),
                (-1.0, self.across[j + 1], self._solutions(m, k, j + 1, radius)),
            ):
                for column, (value, slope) in solutions:
                    system[:, 2 * j, column] = sign * value
                    system[:, 2 * j + 1, column] = sign * sigma * slope
            load[:, 2 * j + 1] = float(j == self.source)
        return np.asarray(np.linalg.solve(system, load[..., None])[:, 0, 0], dtype=np.float64)

    def _solutions(self, m: int, k: Array, layer: int, r: float) -> list[tuple[int, tuple[Array, Array]]]:
        """(unknown, (value, slope) at r) of the layer's independent solutions."""
        q, outer = self._wave_number(k, layer), self.radii[layer]
        growing = _growing(m, q, outer, r)
        if layer == 0:
            return [(0, growing)]
        return [(2 * layer - 1, growing), (2 * layer, _decaying(m, q, self.radii[layer - 1], r))]


def _growing(m: int, q: Array, scale: float, r: ArrayLike) -> tuple[Array, Array]:
    """I_m(q r) / I_m(q scale) and its slope in r; (r / scale)^m where q r is too small for the ratio."""
    q, r = np.broadcast_arrays(q, np.asarray(r, dtype=float))
    top, bottom = ive(m, q * r), ive(m, q * scale)
    usable = bottom > _UNDERFLOW
    decay = np.exp(q * (r - scale)) / np.where(usable, bottom, 1.0)
    power = (r / scale) ** m
    value = np.where(usable, top * decay, power)
    slope = q * (ive(abs(m - 1), q * r) + ive(m + 1, q * r)) / 2 * decay
    return value, np.where(usable, slope, m * power / np.where(r > 0, r, 1.0))


def _decaying(m: int, q: Array, scale: float, r: ArrayLike) -> tuple[Array, Array]:
    """K_m(q r) / K_m(q scale) and its slope in r; its limit (r / scale)^-m, or a logarithm, where q is 0."""
    q, r = np.broadcast_arrays(q, np.asarray(r, dtype=float))
    with np.errstate(over="ignore", invalid="ignore"):
        top, bottom = kve(m, q * r), kve(m, q * scale)
        usable = np.isfinite(bottom) & np.isfinite(kve(m + 1, q * scale)) & (q > 0)
        decay = np.exp(-q * (r - scale)) / np.where(usable, bottom, 1.0)
        slope = -q * (kve(abs(m - 1), q * r) + kve(m + 1, q * r)) / 2 * decay
        value = top * decay
    limit, limit_slope = (
        (1 + np.log(r / scale), 1 / r) if m == 0 else ((r / scale) ** -m, -m / r * (r / scale) ** -m)
    )
    return np.where(usable, value, limit), np.where(usable, slope, limit_slope)


def point_source(across: float, along: float, rho: ArrayLike, z: ArrayLike) -> Array:
    """Potential in volts of 1 mA at the origin of an unbounded medium (Plonsey & Barr 2007, chapter 8).

    Args:
        across, along: conductivities, S/m.
        rho, z: distance from the axis and along it, mm.
    """
    squared = across * along * np.asarray(rho, dtype=float) ** 2 + (across * np.asarray(z, dtype=float)) ** 2
    return np.asarray(1 / (4 * np.pi * np.sqrt(squared)))
