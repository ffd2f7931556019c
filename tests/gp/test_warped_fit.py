"""Fits of warped processes: gradient, choice of warp, relevance of inputs, and which rounds reuse them."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from hdsafebo.gp.warp import warp_scales
from hdsafebo.gp.warped_fit import Standard, Warp, WarpedFit, _loss, first_fit, fit_warped
from hdsafebo.gp.warped_process import WarpedProcess
from hdsafebo.typing import FloatArray


def points(n: int, d: int, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).random((n, d))


def fitted(x: FloatArray, y: FloatArray) -> tuple[WarpedFit, Standard]:
    return fit_warped(x, y, 0.0, first_fit(x.shape[1], warp_scales(y, 0.0)))


def test_gradient_is_that_of_the_density() -> None:
    x = points(30, 4)
    y = np.sin(3 * x[:, 0]) + x[:, 1]
    theta = first_fit(4, ()).theta + np.array([0.3, -0.2, 0.1, 0.4, 3.0])
    found = _loss(theta, x, y)[1]
    np.testing.assert_allclose(found, approx_fprime(theta, lambda t: _loss(t, x, y)[0], 1e-6), rtol=1e-3)


def test_irrelevant_inputs_get_long_length_scales() -> None:
    x = points(80, 5)
    fit, _ = fitted(x, np.sin(6 * x[:, 0]) + np.cos(5 * x[:, 1]))
    lengths = np.exp(fit.log_length_scales)
    assert lengths[2:].min() > 4 * lengths[:2].max()


def test_the_noise_is_not_less_than_its_least() -> None:
    x = points(40, 3)
    y, start = np.sin(3 * x[:, 0]), first_fit(3, ())
    assert fit_warped(x, y, 0.0, start)[0].log_noise < np.log(1e-4)
    assert fit_warped(x, y, 0.0, start, least_noise=1e-3)[0].log_noise >= np.log(1e-3) - 1e-9


def test_equal_inputs_share_their_length_scale() -> None:
    x = points(40, 6)
    fit, _ = fitted(x, -((x - 0.5) ** 2).sum(axis=1))
    assert np.ptp(fit.log_length_scales) < 0.5


def test_values_over_orders_of_magnitude_are_warped_and_smooth_ones_are_not() -> None:
    x = points(60, 2)
    smooth = np.sin(3 * x[:, 0]) + x[:, 1]
    assert np.isinf(fitted(x, smooth)[0].warp_scale)
    fit, standard = fitted(x, np.sinh(9 * smooth))
    assert np.isfinite(fit.warp_scale)
    assert standard.warp.scale == fit.warp_scale


def test_noise_is_found() -> None:
    x = points(120, 2)
    smooth = np.sin(3 * x[:, 0]) + x[:, 1]
    noisy = smooth + 0.1 * np.random.default_rng(1).standard_normal(120)

    def deviation(y: FloatArray) -> float:
        process = WarpedProcess.of(x, y, *fitted(x, y))
        return float(np.sqrt(process.noise_variance) * process.outcomes.unit)

    assert deviation(noisy) == pytest.approx(0.1, rel=0.3)
    assert deviation(smooth) < 0.01


def test_known_noise_is_the_least() -> None:
    x = points(60, 2)
    smooth = np.sin(3 * x[:, 0]) + x[:, 1]
    start = first_fit(2, warp_scales(smooth, 0.0))
    fit, standard = fit_warped(x, smooth, 0.0, start, np.full(60, 0.05))
    assert np.isinf(fit.warp_scale)
    assert np.exp(fit.log_noise) >= 0.999 * (0.05 / standard.unit) ** 2
    unknown, _ = fit_warped(x, smooth, 0.0, start, np.full(60, np.nan))
    assert unknown.log_noise < fit.log_noise


def test_hyperparameters_are_searched_when_the_data_have_grown() -> None:
    x = points(110, 2)
    y = np.sin(3 * x[:, 0]) + x[:, 1]
    first, _ = fitted(x[:100], y[:100])
    same, _ = fit_warped(x[:102], y[:102], 0.0, first)
    assert same.theta.tolist() == first.theta.tolist()
    assert (same.fits, same.fitted_at) == (2, 100)
    later, _ = fit_warped(x, y, 0.0, same)
    assert later.fitted_at == 110
    assert later.thorough_at == 100
    assert later.theta.tolist() != first.theta.tolist()


@pytest.mark.parametrize("kind", ["constant", "equal points", "outlier", "one"])
def test_hostile_data_are_fitted(kind: str) -> None:
    x = points(20, 3)
    y = np.sin(3 * x[:, 0])
    if kind == "constant":
        y[:] = 2.0
    if kind == "equal points":
        x[:] = x[0]
    if kind == "outlier":
        y[3] = 1e12
    if kind == "one":
        x, y = x[:1], y[:1]
    fit, standard = fitted(x, y)
    assert np.isfinite(fit.theta).all()
    assert np.isfinite(standard.apply(y)).all()
    assert Standard.of(np.full(3, 2.0), Warp(0.0)).unit == 1.0
