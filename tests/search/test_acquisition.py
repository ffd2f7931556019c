"""Logarithmic acquisition values against quadrature, BoTorch and finite differences."""

import numpy as np
import pytest
from scipy.stats import norm

from hdsafebo.search.acquisition import log_expected_improvement, log_feasibility, maximise

U = np.array([-4.0, -1.0, 0.0, 0.5, 3.0, 4.999, 5.001, 20.0])
DEEP = np.array([-2000.0, -1000.5, -999.5, -60.0])


@pytest.mark.parametrize("u", U)
def test_improvement_is_the_closed_form(u: float) -> None:
    sd = np.array([0.7])
    value = log_expected_improvement(1.0 + u * sd, sd, 1.0)[0]
    np.testing.assert_allclose(np.exp(value), sd * (norm.pdf(u) + u * norm.cdf(u)), rtol=1e-10)


@pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
def test_deep_tail_is_that_of_botorch() -> None:
    torch = pytest.importorskip("torch")
    from botorch.acquisition.analytic import _log_ei_helper

    ours = log_expected_improvement(DEEP, np.ones(len(DEEP)), 0.0)[0]
    np.testing.assert_allclose(ours, _log_ei_helper(torch.tensor(DEEP)).numpy(), rtol=1e-10)


@pytest.mark.parametrize("function", [log_expected_improvement, log_feasibility])
def test_derivatives(function) -> None:
    mean, sd = np.concatenate([U, DEEP]) / 3, np.full(len(U) + len(DEEP), 0.8)
    _, d_mean, d_sd = function(mean, sd, 0.3)
    e = 1e-6
    numeric_mean = (function(mean + e, sd, 0.3)[0] - function(mean - e, sd, 0.3)[0]) / (2 * e)
    numeric_sd = (function(mean, sd + e, 0.3)[0] - function(mean, sd - e, 0.3)[0]) / (2 * e)
    np.testing.assert_allclose(d_mean, numeric_mean, rtol=1e-4, atol=1e-8)
    np.testing.assert_allclose(d_sd, numeric_sd, rtol=1e-4, atol=1e-8)


def test_feasibility_is_the_normal_distribution() -> None:
    value = log_feasibility(np.array([0.2]), np.array([0.5]), -0.3)[0]
    assert np.exp(value[0]) == pytest.approx(norm.sf(-0.3, 0.2, 0.5))


def test_ascent_takes_the_best_of_its_starts() -> None:
    peaks, heights = np.array([[0.2, 0.2], [0.8, 0.9]]), np.array([1.0, 2.0])

    def two_hills(x):
        squared = ((x[:, None] - peaks) ** 2).sum(-1)
        hills = heights * np.exp(-squared / 0.02)
        return hills.sum(1), (-(x[:, None] - peaks) * (hills / 0.01)[..., None]).sum(1)

    point, value = maximise(two_hills, np.array([[0.25, 0.2], [0.75, 0.85]]), np.zeros(2), np.ones(2))
    np.testing.assert_allclose(point, peaks[1], atol=1e-4)
    assert value == pytest.approx(2.0, abs=1e-6)


def test_ascent_stays_in_the_box() -> None:
    point, _ = maximise(
        lambda x: (x.sum(1), np.ones_like(x)), np.full((3, 2), 0.5), np.zeros(2), np.array([0.6, 1.0])
    )
    np.testing.assert_allclose(point, [0.6, 1.0])
