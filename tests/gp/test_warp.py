"""Warps: inverse, Jacobian, and scales from the first data."""

import numpy as np
import pytest

from hdsafebo.gp.warp import Warp, warp_scales

VALUES = np.array([-1e9, -3.0, -0.1, 0.5, 2.0, 1e9])


@pytest.mark.parametrize("scale", [np.inf, 0.01, 1.0])
def test_restoring_undoes_and_order_is_kept(scale: float) -> None:
    warp = Warp(0.5, scale)
    warped = warp.apply(VALUES)
    assert (np.diff(warped) > 0).all()
    np.testing.assert_allclose(warp.restore(warped), VALUES, rtol=1e-9, atol=1e-12)
    assert warp.apply(np.array([0.5]))[0] == 0.0


@pytest.mark.parametrize("scale", [np.inf, 0.3])
def test_jacobian_is_the_derivative(scale: float) -> None:
    warp, y, step = Warp(0.2, scale), np.array([-2.0, 0.1, 4.0]), 1e-6
    slope = (warp.apply(y + step) - warp.apply(y - step)) / (2 * step)
    assert warp.log_jacobian(y) == pytest.approx(np.log(slope).sum(), abs=1e-6)


def test_absurd_values_stay_finite() -> None:
    warp = Warp(0.0, 1.0)
    assert np.isfinite(warp.apply(np.array([1e300, -1e300]))).all()
    assert np.isfinite(warp.restore(np.array([1e6, -1e6]))).all()


def test_scales_are_quantiles_of_the_distances() -> None:
    scales = warp_scales(np.arange(1.0, 102.0), 1.0)
    np.testing.assert_allclose(scales, np.quantile(np.arange(1.0, 101.0), [0.1, 0.3, 0.6, 0.9]))
    assert warp_scales(np.array([1.0, 1.0, 2.0, 3.0, 4.0]), 1.0) == ()  # too few that differ from the centre
