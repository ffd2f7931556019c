"""Known noise, failures, and predictions of measurements, held against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from hdsafebo.gp.fit import fit_gaussian_process
from hdsafebo.gp.kernel import exact_distances, matern52
from hdsafebo.gp.sampling import SamplePaths
from hdsafebo.gp.surrogate import SurrogateState, fit_surrogate, with_completion


def data(n: int = 40, seed: int = 0):
    rng = np.random.default_rng(seed)
    x = rng.random((n, 2))
    return x, np.sin(4 * x[:, 0]) + x[:, 1], rng.standard_normal(n)


def test_posterior_is_that_of_the_known_noise() -> None:
    """Mean and variance at given hyper-parameters, by the textbook formula with a diagonal of variances."""
    x, y, e = data()
    sd = np.where(np.arange(40) < 20, 0.05, 0.6)
    gp = fit_gaussian_process(x, exact_distances(x, x), y + sd * e, known_noise=sd)
    q = np.random.default_rng(1).random((7, 2))
    signal = gp.signal_deviation**2
    k = signal * matern52(exact_distances(x, x), gp.length_scale) + np.diag(sd**2)
    cross = signal * matern52(exact_distances(q, x), gp.length_scale)
    mean = gp.outcomes.centre + gp.outcomes.scale * gp.mean
    expected = mean + cross @ np.linalg.solve(k, y + sd * e - mean)
    variance = signal - np.einsum("ij,ji->i", cross, np.linalg.solve(k, cross.T))
    found, deviation = gp.predict(q)
    np.testing.assert_allclose(found, expected, rtol=1e-8)
    np.testing.assert_allclose(deviation**2, variance, rtol=1e-6)
    np.testing.assert_allclose(gp.noise_ratios * signal, sd**2)


def test_density_is_maximal_at_the_fit() -> None:
    """Against the marginal likelihood computed from scratch, with the priors of the fit, on a grid."""
    x, y, e = data(30)
    sd = np.full(30, 0.3)
    gp = fit_gaussian_process(x, exact_distances(x, x), y + sd * e, known_noise=sd)
    values = gp.values
    nu = (0.3 / gp.outcomes.scale) ** 2
    distances = exact_distances(x, x)

    def density(log_length: float, log_signal: float) -> float:
        q = np.exp(log_signal)
        k = q * matern52(distances, np.exp(log_length)) + nu * np.eye(30)
        inverse = np.linalg.inv(k)
        mean = inverse.sum(axis=0) @ values / inverse.sum()
        residual = values - mean
        likelihood = -0.5 * residual @ inverse @ residual - 0.5 * np.linalg.slogdet(k)[1]
        prior = -0.5 * ((log_length - np.log(gp.hyper.reference)) / 2.0) ** 2
        return likelihood - log_signal - 1.0 / q + prior  # two pseudo-observations of variance one

    best = density(np.log(gp.length_scale), np.log(gp.variance))
    grid = [density(a, b) for a in np.linspace(-3, 1.0, 30) for b in np.linspace(-3, 3, 30)]
    assert best >= max(grid) - 0.2, "within what one parabola leaves of the maximum"


def test_a_warm_start_keeps_the_noise_known() -> None:
    x, y, e = data()
    sd = np.full(40, 0.2)
    first = fit_surrogate(
        x[:30], y[:30] + sd[:30] * e[:30], y[:30, None], np.zeros(1), known_noise=np.full((30, 2), 0.2)
    )
    state = SurrogateState.from_json(first.state.to_json())
    then = fit_surrogate(
        x, y + sd * e, y[:, None], np.zeros(1), start=state, known_noise=np.full((40, 2), 0.2)
    )
    assert then.objective.hyper.noise_ratio * then.objective.signal_deviation**2 == pytest.approx(0.04)


def test_partly_known_noise_is_found_by_the_model() -> None:
    x, y, e = data()
    known = np.full((40, 2), 0.2)
    known[3, 0] = np.nan
    made = fit_surrogate(x, y + 0.2 * e, y[:, None], np.zeros(1), known_noise=known)
    assert made.objective.relative_noise is None
    assert made.safety[0].relative_noise is not None


def test_where_noise_is_known_the_next_measurement_is_predicted() -> None:
    """Variances of function and measurement add up; a limit on the measured value is met that often."""
    rng = np.random.default_rng(3)
    x = rng.random((150, 1))
    g = 2 * x[:, 0] - 1
    made = fit_surrogate(
        x, g, (g + 0.5 * rng.standard_normal(150))[:, None], np.zeros(1), known_noise=np.full((150, 2), 0.5)
    )
    q = np.linspace(0, 1, 9)[:, None]
    mean, deviation = made.predict_safety(q)
    of_function = replace(made.safety[0], predicted_noise=0.0).predict(q)[1]
    np.testing.assert_allclose(deviation[:, 0] ** 2, of_function**2 + 0.25, rtol=1e-9)
    np.testing.assert_allclose(made.safe_probability(q), ndtr(mean / deviation)[:, 0])
    predicted = made.safety[0].predict_with_gradient(q)[1]
    np.testing.assert_allclose(predicted, deviation[:, 0], rtol=1e-9)
    mean, deviation = made.predict_safety(x)
    for beta in (-2.0, -1.0, 0.5):
        np.testing.assert_array_equal(made.believed_safe(x, beta), (mean + beta * deviation >= 0)[:, 0])


def test_sample_paths_have_the_posteriors_spread() -> None:
    x, y, e = data()
    sd = np.where(np.arange(40) < 20, 0.02, 1.0)
    gp = fit_gaussian_process(x, exact_distances(x, x), y + sd * e, known_noise=sd)
    q = np.random.default_rng(1).random((6, 2))
    values = np.hstack([SamplePaths(gp, 100, np.random.default_rng(s)).values(q) for s in range(10)])
    mean, deviation = gp.predict(q)
    np.testing.assert_allclose(values.mean(axis=1), mean, atol=5 * deviation.max() / np.sqrt(1000) + 0.05)
    np.testing.assert_allclose(values.std(axis=1), deviation, rtol=0.25)


def test_failures_are_kept_away_from_and_forget_nothing() -> None:
    x, y, _ = data(30)
    made = fit_surrogate(x, y, y[:, None] + 5, np.zeros(1))
    failed = np.array([[0.9, 0.9], [0.93, 0.88]])
    with_failures = with_completion(made, np.vstack([x, failed]), None)
    assert with_failures.completion
    assert with_failures.measured == 1
    assert (made.safe_probability(failed) > 0.99).all()
    assert (with_failures.safe_probability(failed) < 0.3).all()
    far = x[np.linalg.norm(x - 0.9, axis=1) > 0.7]
    assert (with_failures.safe_probability(far) > 0.9).all()
    np.testing.assert_array_equal(with_failures.violation_bound(x, -2.0), made.violation_bound(x, -2.0))
    again = fit_surrogate(x, y, y[:, None] + 5, np.zeros(1), start=with_failures.state)
    assert again.state.safety[0].fits == with_failures.state.safety[0].fits + 1
