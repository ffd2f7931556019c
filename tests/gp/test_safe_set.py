"""Probabilities and bounds against simulation and quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from hdsafebo.errors import ParamsError
from hdsafebo.gp.safe_set import alpha_of, beta_of, safe_probabilities, violation_bound


def test_beta_two_promises_little() -> None:
    assert alpha_of(2.0) == pytest.approx(0.02275, abs=1e-5)
    assert alpha_of(-2.0) == pytest.approx(0.97725, abs=1e-5)


@pytest.mark.parametrize("alpha", [0.001, 0.3, 0.5, 0.977, 1 - 1e-12])
def test_beta_of_inverts_alpha_of(alpha: float) -> None:
    assert alpha_of(beta_of(alpha)) == pytest.approx(alpha)
    assert norm.cdf(beta_of(alpha)) <= 1 - alpha + 1e-12  # the premise of Proposition 1


@pytest.mark.parametrize("alpha", [0.0, 1.0, -1.0, float("nan")])
def test_impossible_alpha(alpha: float) -> None:
    with pytest.raises(ParamsError, match="alpha"):
        beta_of(alpha)


@pytest.mark.parametrize("beta", [-2.0, 0.0, 0.5, 2.0])
def test_proposition_1(beta: float) -> None:
    """Pr(g >= mu + beta sigma) = 1 - Phi(beta)."""
    g = np.random.default_rng(0).normal(1.3, 0.7, 400_000)
    share = (g >= 1.3 + beta * 0.7).mean()
    assert share == pytest.approx(alpha_of(beta), abs=4 * np.sqrt(0.25 / len(g)))


def test_each_function_has_its_probability() -> None:
    mean, deviation = np.array([[1.0, -0.5]]), np.array([[0.5, 1.0]])
    expected = [norm.sf(0.2, 1.0, 0.5), norm.sf(0.3, -0.5, 1.0)]
    np.testing.assert_allclose(safe_probabilities(mean, deviation, np.array([0.2, 0.3])), [expected])


@pytest.mark.parametrize("mu", [-1.0, 0.0, 0.4, 2.0])
def test_without_beta_the_bound_is_the_expected_violation(mu: float) -> None:
    h, sigma = 0.25, 0.6
    exact, _ = quad(lambda g: max(0.0, h - g) * norm.pdf(g, mu, sigma), mu - 9 * sigma, h, limit=200)
    bound = violation_bound(np.array([[mu]]), np.array([[sigma]]), np.array([h]), None)
    np.testing.assert_allclose(bound, exact, rtol=1e-8)


@pytest.mark.parametrize("beta", [-2.0, 0.0, 2.0])
def test_bound_holds_and_is_tight_on_the_border_of_the_safe_set(beta: float) -> None:
    sigma, h = 0.6, 0.25
    mu = np.linspace(h - 3, h + 3, 201)[:, None]
    bound = violation_bound(mu, np.full_like(mu, sigma), np.array([h]), beta)
    exact = violation_bound(mu, np.full_like(mu, sigma), np.array([h]), None)
    assert (bound >= exact).all()
    inside = mu[:, 0] + beta * sigma >= h
    np.testing.assert_allclose(bound[inside], sigma * (beta * norm.cdf(beta) + norm.pdf(beta)))
    border = violation_bound(np.array([[h - beta * sigma]]), np.array([[sigma]]), np.array([h]), None)
    np.testing.assert_allclose(bound[inside][0], border[0])


def test_violations_add_up_over_functions() -> None:
    mean, deviation, h = np.array([[0.0, 1.0]]), np.array([[1.0, 2.0]]), np.array([0.5, 0.0])
    both = violation_bound(mean, deviation, h, -2.0)
    parts = [violation_bound(mean[:, [j]], deviation[:, [j]], h[[j]], -2.0) for j in (0, 1)]
    np.testing.assert_allclose(both, sum(parts))
