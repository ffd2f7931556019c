"""Posterior and fit against closed forms, GPyTorch and finite differences."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from hdsafebo.errors import SurrogateError
from hdsafebo.gp import fit
from hdsafebo.gp import fit as gp_fit
from hdsafebo.gp.fit import NoisePrior, fit_gaussian_process
from hdsafebo.gp.gaussian_process import GaussianProcess
from hdsafebo.gp.kernel import exact_distances, matern52


def smooth_data(n: int = 60, d: int = 3, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = rng.random((n, d))
    return x, 5.0 + 2.0 * np.sin(3 * x[:, 0]) + x[:, 1] ** 2 + 0.01 * rng.standard_normal(n)


def fitted(x: np.ndarray, y: np.ndarray, **kwargs) -> GaussianProcess:
    return fit_gaussian_process(x, exact_distances(x, x), y, **kwargs)


def closed_form(gp: GaussianProcess, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Equation (2) of the paper with the fitted hyper-parameters, mean included, by a dense inverse."""
    ls, ratio = gp.hyper.length_scale, gp.hyper.noise_ratio
    inverse = np.linalg.inv(
        matern52(exact_distances(gp.inputs, gp.inputs), ls) + ratio * np.eye(len(gp.inputs))
    )
    ones = np.ones(len(gp.inputs))
    mean = ones @ inverse @ gp.values / (ones @ inverse @ ones)
    k = matern52(exact_distances(x, gp.inputs), ls)
    mu = gp.outcomes.centre + gp.outcomes.scale * (mean + k @ inverse @ (gp.values - mean))
    prior = matern52(exact_distances(x, x), ls)
    residual = gp.values - mean
    variance = (residual @ inverse @ residual + 2.0) / (len(ones) + 2.0)
    return mu, gp.outcomes.scale**2 * variance * (prior - k @ inverse @ k.T)


def test_posterior_is_the_closed_form() -> None:
    gp = fitted(*smooth_data())
    x = np.random.default_rng(1).random((9, 3))
    mu, covariance = closed_form(gp, x)
    mean, deviation = gp.predict(x)
    np.testing.assert_allclose(mean, mu, rtol=1e-7)
    np.testing.assert_allclose(gp.predict_mean(x), mean)
    np.testing.assert_allclose(deviation, np.sqrt(np.diag(covariance)), rtol=1e-4)
    np.testing.assert_allclose(gp.covariance(x), covariance, atol=1e-6 * covariance.max())


def test_gradients_are_finite_differences() -> None:
    gp = fitted(*smooth_data())
    x = np.random.default_rng(2).random((5, 3))
    mean, deviation, mean_gradient, deviation_gradient = gp.predict_with_gradient(x)
    np.testing.assert_allclose(mean, gp.predict(x)[0], rtol=1e-9)
    np.testing.assert_allclose(deviation, gp.predict(x)[1], rtol=1e-5)
    step = 1e-5
    for i in range(3):
        shift = step * np.eye(3)[i]
        high, low = gp.predict_with_gradient(x + shift), gp.predict_with_gradient(x - shift)
        np.testing.assert_allclose(mean_gradient[:, i], (high[0] - low[0]) / (2 * step), rtol=1e-4, atol=1e-6)
        np.testing.assert_allclose(
            deviation_gradient[:, i], (high[1] - low[1]) / (2 * step), rtol=1e-2, atol=1e-4
        )


def test_a_fit_that_keeps_hyperparameters_is_their_closed_form() -> None:
    """With more data; without a fit before it there is nothing to keep, and they are searched."""
    x, y = smooth_data()
    first = fitted(x[:40], y[:40])
    kept = fitted(x, y, start=first.hyper, refine=False)
    assert kept.hyper.fits == first.hyper.fits
    assert kept.length_scale == pytest.approx(first.length_scale, rel=1e-12)
    assert kept.hyper.noise_ratio == pytest.approx(first.hyper.noise_ratio, rel=1e-12)
    at = np.random.default_rng(1).random((9, 3))
    np.testing.assert_allclose(kept.predict_mean(at), closed_form(kept, at)[0], rtol=1e-7)
    searched = fitted(x, y, start=first.hyper)
    assert searched.hyper.length_scale != pytest.approx(first.length_scale, rel=1e-6)
    unknown = fitted(x, y, refine=False)
    assert unknown.hyper == fitted(x, y).hyper


def log_posterior(theta: np.ndarray, gp: GaussianProcess) -> float:
    """Density of the standardised outcomes with mean and variance as parameters, plus the priors."""
    log_length, log_noise, mean, log_variance = theta
    variance, n = np.exp(log_variance), len(gp.values)
    covariance = variance * (
        matern52(exact_distances(gp.inputs, gp.inputs), np.exp(log_length)) + np.exp(log_noise) * np.eye(n)
    )
    density = multivariate_normal.logpdf(gp.values, np.full(n, mean), covariance)
    density -= log_variance + 1.0 / variance  # inverse gamma: two pseudo-observations of unit variance
    density -= 0.5 * ((log_length - np.log(gp.hyper.reference)) / 2.0) ** 2
    return density - 0.5 * ((log_noise - np.log(1e-4)) / 2.0) ** 2


def test_fit_is_the_maximum_of_the_full_posterior_density(monkeypatch: pytest.MonkeyPatch) -> None:
    """Profiling mean and variance out of the search finds what a search over all four parameters finds."""
    x, y = smooth_data(40)
    monkeypatch.setattr(fit, "_LENGTH_LIMITS", (0.01, 30.0))
    gp = fitted(x, y)
    for _ in range(15):
        gp = fitted(x, y, start=gp.hyper)
    ours = np.array([np.log(gp.length_scale), np.log(gp.hyper.noise_ratio), gp.mean, np.log(gp.variance)])
    best = minimize(
        lambda t: -log_posterior(t, gp), ours + 0.1, method="Nelder-Mead", options={"maxiter": 4000}
    )
    assert log_posterior(ours, gp) > -best.fun - 0.05
    np.testing.assert_allclose(np.exp(ours[0]), np.exp(best.x[0]), rtol=0.1)


def test_length_scale_and_noise_are_recovered() -> None:
    rng = np.random.default_rng(3)
    x = rng.random((300, 2))
    covariance = matern52(exact_distances(x, x), 0.3) + 0.01 * np.eye(300)
    y = 7.0 + 3.0 * np.linalg.cholesky(covariance) @ rng.standard_normal(300)
    gp = fitted(x, y)
    for _ in range(12):
        gp = fitted(x, y, start=gp.hyper)
    assert 0.2 < gp.length_scale < 0.45
    assert 0.004 < gp.hyper.noise_ratio < 0.025


def test_affine_changes_of_the_outcomes_change_nothing_else() -> None:
    x, y = smooth_data()
    one, other = fitted(x, y), fitted(x, 1e6 * y - 3e7)
    assert one.length_scale == pytest.approx(other.length_scale, rel=1e-6)
    points = np.random.default_rng(4).random((4, 3))
    np.testing.assert_allclose(1e6 * one.predict(points)[1], other.predict(points)[1], rtol=1e-4)


@pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
def test_posterior_is_that_of_gpytorch() -> None:
    import gpytorch
    import torch

    gp = fitted(*smooth_data())

    class Exact(gpytorch.models.ExactGP):
        def __init__(self, x, y, likelihood) -> None:
            super().__init__(x, y, likelihood)
            self.mean_module = gpytorch.means.ConstantMean()
            self.covar_module = gpytorch.kernels.ScaleKernel(gpytorch.kernels.MaternKernel(nu=2.5))

        def forward(self, x):
            return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))

    noise = torch.full((len(gp.values),), gp.variance * gp.hyper.noise_ratio, dtype=torch.float64)
    likelihood = gpytorch.likelihoods.FixedNoiseGaussianLikelihood(noise)
    model = Exact(torch.from_numpy(gp.inputs), torch.from_numpy(gp.values), likelihood).double().eval()
    model.mean_module.constant = gp.mean
    model.covar_module.outputscale = gp.variance
    model.covar_module.base_kernel.lengthscale = gp.length_scale
    x = np.random.default_rng(5).random((6, 3))
    with torch.no_grad(), gpytorch.settings.fast_computations(False, False, False):
        posterior = model(torch.from_numpy(x))
    mean, deviation = gp.predict(x)
    np.testing.assert_allclose(mean, gp.outcomes.restore(posterior.mean.numpy()), rtol=1e-7)
    np.testing.assert_allclose(deviation, gp.outcomes.scale * posterior.stddev.numpy(), rtol=1e-4)


@pytest.mark.parametrize(
    "y",
    [
        np.full(30, 2.0),
        np.append(np.linspace(0, 1, 29), 1e12),
        np.append(np.linspace(0, 1, 29), -1e300),
        np.tile([0.0, 1.0], 15),
    ],
)
def test_ill_natured_outcomes_give_finite_predictions(y: np.ndarray) -> None:
    x = np.random.default_rng(6).random((30, 4))
    mean, deviation = fitted(x, y).predict(x)
    assert np.isfinite(mean).all()
    assert np.isfinite(deviation).all()
    assert (deviation > 0).all()


def test_thirty_equal_points_and_one_point() -> None:
    for x in (np.tile([[0.3, 0.4]], (30, 1)), np.array([[0.3, 0.4]])):
        y = 1.0 + 0.1 * np.random.default_rng(7).standard_normal(len(x))
        gp = fitted(x, y)
        mean, deviation = gp.predict(np.array([[0.3, 0.4], [0.9, 0.9]]))
        np.testing.assert_allclose(mean[0], y.mean(), atol=0.1)
        assert deviation[0] < deviation[1]


def test_limits_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    x, y = smooth_data()
    monkeypatch.setattr(fit, "_LENGTH_LIMITS", (0.1, 0.2))
    gp = fitted(x, y)
    assert 0.1 - 1e-9 <= gp.length_scale / gp.hyper.reference <= 0.2 + 1e-9


def test_warm_fit_costs_few_evaluations_and_does_not_get_worse(monkeypatch: pytest.MonkeyPatch) -> None:
    x, y = smooth_data(80)
    gp = fitted(x, y)
    for _ in range(4):
        gp = fitted(x, y, start=gp.hyper)
    calls = []
    evaluate = gp_fit._Search._evaluate
    monkeypatch.setattr(gp_fit._Search, "_evaluate", lambda *a: calls.append(1) or evaluate(*a))
    warm = fitted(x, y, start=gp.hyper)
    assert len(calls) <= 7
    assert warm.hyper.fits == gp.hyper.fits + 1


def test_jitter_ladder_then_last_good_fit_then_abstention(monkeypatch: pytest.MonkeyPatch) -> None:
    x, y = smooth_data()
    good = fitted(x, y)
    evaluate = gp_fit._Search._evaluate

    def only_with(least: float):
        return lambda self, theta, jitter: evaluate(self, theta, jitter) if jitter >= least else None

    monkeypatch.setattr(gp_fit._Search, "_evaluate", only_with(1e-6))
    kept = fitted(x, y, start=good.hyper)
    assert kept.length_scale == pytest.approx(good.length_scale)
    assert (kept.hyper.jitters, kept.hyper.fallbacks) == (1, 1)
    monkeypatch.setattr(gp_fit._Search, "_evaluate", only_with(1.0))
    with pytest.raises(SurrogateError, match="60 points has no Cholesky factor at length scale"):
        fitted(x, y, start=good.hyper)


def test_noise_prior_moves_the_noise_and_limits_it() -> None:
    x, y = smooth_data()
    plain = fitted(x, y)
    noisy = fitted(x, y, noise=NoisePrior(mode=0.1, spread=1.0, least=0.03, first=(0.05, 0.4)))
    assert plain.hyper.noise_ratio < 0.01
    assert noisy.hyper.noise_ratio == pytest.approx(0.03, rel=0.3)
    assert noisy.hyper.noise_ratio >= 0.03 * (1 - 1e-9)
    assert fitted(x, y, noise=NoisePrior(least=0.2)).hyper.noise_ratio == pytest.approx(0.2)
    kept = fitted(x, y, noise=NoisePrior(least=0.03), start=plain.hyper, refine=False)
    assert kept.hyper.noise_ratio == pytest.approx(0.03)  # what a start lies outside of
