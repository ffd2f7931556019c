"""The exact solution against simpler exact solutions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hdsafebo.spinal.finite_elements.reference_cylinder import LayeredCylinder, point_source

Z = np.linspace(35.0, 65.0, 61)


def patch_in_free_space(cylinder: LayeredCylinder, r: float, z: np.ndarray) -> np.ndarray:
    """Potential of the cylinder's patch in an unbounded medium of its first layer's conductivity."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    a = cylinder.radii[cylinder.source]
    angle = nodes * cylinder.half_arc / a
    total = np.zeros(z.shape)
    for theta, wt in zip(angle, weights, strict=True):
        for shift, wz in zip(nodes * cylinder.half_length, weights, strict=True):
            rho = np.hypot(a * np.cos(theta) - r, a * np.sin(theta))
            along = z - cylinder.centre - shift
            total += wt * wz / 4 * point_source(cylinder.across[0], cylinder.along[0], rho, along)
    return total


@pytest.mark.parametrize("along", [0.3, 1.2])
def test_a_large_homogeneous_cylinder_is_free_space(along: float) -> None:
    """The grounded mantle adds a nearly constant potential: differences and curvatures agree."""
    wide = LayeredCylinder(
        radii=(4.5, 8.3, 150.0), across=(0.3,) * 3, along=(along,) * 3, length=600.0, source=1, centre=300.0
    )
    z = wide.centre + np.linspace(-12.0, 12.0, 9)
    for r in (0.0, 2.0, 4.0):
        found, curvature = wide.potential(r, 0.0, z, orders=30, harmonics=1000)
        free = patch_in_free_space(wide, r, z)
        difference = found - free
        assert np.ptp(difference) < 2e-3 * np.ptp(free)
        step = 0.05
        second = (
            sum(w * patch_in_free_space(wide, r, z + s) for w, s in ((1, -step), (-2, 0), (1, step)))
            / step**2
        )
        np.testing.assert_allclose(curvature, second, atol=2e-3 * np.abs(second).max())


def test_equal_layers_are_one_layer() -> None:
    four = LayeredCylinder(across=(0.2,) * 4, along=(0.5,) * 4)
    two = LayeredCylinder(radii=(8.3, 12.0), across=(0.2,) * 2, along=(0.5,) * 2, source=0)
    for a, b in zip(four.potential(4.0, 0.3, Z), two.potential(4.0, 0.3, Z), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-14)


def test_curvature_is_the_second_derivative_and_the_series_has_converged() -> None:
    cylinder, step = LayeredCylinder(), 1e-2
    r = np.array([[0.0], [2.0], [4.0]])
    _, curvature = cylinder.potential(r, 0.0, Z)
    second = (
        sum(w * cylinder.potential(r, 0.0, Z + s)[0] for w, s in ((1, -step), (-2, 0), (1, step))) / step**2
    )
    np.testing.assert_allclose(curvature, second, atol=1e-4 * np.abs(curvature).max())
    _, longer = cylinder.potential(r, 0.0, Z, orders=40, harmonics=400)
    np.testing.assert_allclose(curvature, longer, atol=1e-6 * np.abs(curvature).max())


def test_the_potential_solves_the_equation_of_the_core() -> None:
    """sigma_r (V_rr + V_r / r + V_tt / r^2) + sigma_z V_zz = 0 inside the innermost layer."""
    cylinder, h = LayeredCylinder(), 0.02
    r, theta, z = 3.0, 0.4, Z[::6]

    def v(dr: float, dt: float) -> np.ndarray:
        return cylinder.potential(r + dr, theta + dt, z)[0]

    centre, curvature = cylinder.potential(r, theta, z)
    radial = (v(h, 0) - 2 * centre + v(-h, 0)) / h**2 + (v(h, 0) - v(-h, 0)) / (2 * h) / r
    angular = (v(0, h) - 2 * centre + v(0, -h)) / h**2 / r**2
    residual = cylinder.across[0] * (radial + angular) + cylinder.along[0] * curvature
    assert np.abs(residual).max() < 1e-3 * np.abs(cylinder.along[0] * curvature).max()


def test_a_better_conducting_fluid_shields_the_core() -> None:
    default = LayeredCylinder()
    resistive = replace(default, across=(0.083, 0.1, 0.03, 0.04), along=(0.6, 0.1, 0.03, 0.04))
    assert default.potential(4.0, 0.0, 50.0)[0] < resistive.potential(4.0, 0.0, 50.0)[0]
