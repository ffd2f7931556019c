"""Sobol points, sample paths against the posterior, Thompson sampling against joint sampling."""

import warnings

import numpy as np
import pytest

from hdsafebo.gp.fit import fit_gaussian_process
from hdsafebo.gp.kernel import exact_distances
from hdsafebo.gp.sampling import SamplePaths, thompson_sample
from hdsafebo.search.candidates import sobol_points


@pytest.fixture(scope="module")
def gp():
    rng = np.random.default_rng(0)
    x = rng.random((40, 3))
    y = 10.0 + 4.0 * np.sin(5 * x[:, 0]) + 0.05 * rng.standard_normal(40)
    return fit_gaussian_process(x, exact_distances(x, x), y)


@pytest.mark.parametrize("n", [1, 2, 1000, 5000])
def test_sobol_points_fill_the_cube_evenly(n: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        points = sobol_points(n, 6, np.random.default_rng(1))
    assert points.shape == (n, 6)
    assert (points >= 0).all()
    assert (points <= 1).all()
    if n >= 1000:
        np.testing.assert_allclose(points.mean(axis=0), 0.5, atol=0.005)
        assert len(np.unique(points, axis=0)) == n


@pytest.mark.parametrize(("frequencies", "tolerance"), [(512, 0.25), (4096, 0.1)])
@pytest.mark.thorough
def test_paths_have_mean_and_covariance_of_the_posterior(gp, frequencies: int, tolerance: float) -> None:
    """The finite number of features makes the prior sample approximate; the error falls with their number."""
    rng = np.random.default_rng(2)
    x = np.vstack([rng.random((6, 3)), [[2.0, 2.0, 2.0]], gp.inputs[:1]])
    values = np.hstack([SamplePaths(gp, 100, rng, frequencies).values(x) for _ in range(40)])
    deviation = np.sqrt(np.diag(gp.covariance(x)))
    assert (np.abs(values.mean(axis=1) - gp.predict_mean(x)) < 0.08 * deviation + 1e-6).all()
    assert (np.abs(np.cov(values) - gp.covariance(x)) < tolerance * np.outer(deviation, deviation)).all()


def test_path_gradients_are_finite_differences(gp) -> None:
    rng = np.random.default_rng(3)
    paths = SamplePaths(gp, 4, rng)
    x, step = rng.random((4, 3)), 1e-6
    value, gradient = paths.value_and_gradient(x)
    np.testing.assert_allclose(value, np.diag(paths.values(x)), rtol=1e-6)
    for i in range(3):
        shift = step * np.eye(3)[i]
        ends = [paths.value_and_gradient(x + s * shift)[0] for s in (1, -1)]
        np.testing.assert_allclose(gradient[:, i], (ends[0] - ends[1]) / (2 * step), rtol=1e-4, atol=1e-4)


def test_paths_pass_through_precise_data(gp) -> None:
    values = SamplePaths(gp, 200, np.random.default_rng(4)).values(gp.inputs[:5])
    noise = gp.signal_deviation * np.sqrt(gp.hyper.noise_ratio)
    np.testing.assert_allclose(values.mean(axis=1), gp.outcomes.restore(gp.values[:5]), atol=3 * noise)


@pytest.mark.thorough
def test_thompson_rows_differ_and_follow_joint_sampling(gp) -> None:
    """How often each of a few points is the best of a sample: paths against exact joint draws."""
    rng = np.random.default_rng(5)
    x = np.column_stack([rng.uniform(0.2, 0.5, 12), rng.random((12, 2)) * 3])
    joint = rng.multivariate_normal(gp.predict_mean(x), gp.covariance(x), 20_000, method="eigh")
    expected = np.bincount(joint.argmax(axis=1), minlength=12) / 20_000
    draws = np.array([SamplePaths(gp, 1, rng).values(x).argmax() for _ in range(600)])
    observed = np.bincount(draws, minlength=12) / len(draws)
    assert np.abs(observed - expected).max() < 0.08
    assert expected.max() < 0.9  # the test could not fail if one point always won
    assert len(set(thompson_sample(gp, x, 12, rng).tolist())) == 12
