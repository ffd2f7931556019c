"""Lazily revealed paths against the full factorisation and the kernel's moments."""

import numpy as np
import pytest

from hdsafebo.gp.kernel import exact_distances, matern52
from hdsafebo.problems.gaussian_path import GaussianPath


def test_values_are_those_of_the_full_factorisation() -> None:
    x = np.random.default_rng(0).random((80, 5))
    path = GaussianPath(5, 0.4, 1e-4, np.random.default_rng(1))
    revealed = np.concatenate([path(part) for part in np.split(x, [1, 4, 30, 31, 70])])
    covariance = matern52(exact_distances(x, x), 0.4) + 1e-4 * np.eye(80)
    normals = np.random.default_rng(1).standard_normal(80)
    np.testing.assert_allclose(revealed, np.linalg.cholesky(covariance) @ normals, atol=1e-9)


def test_order_of_revealing_matters_only_through_the_normals() -> None:
    x = np.random.default_rng(2).random((20, 3))
    whole = GaussianPath(3, 0.5, 1e-4, np.random.default_rng(3))(x)
    path = GaussianPath(3, 0.5, 1e-4, np.random.default_rng(3))
    np.testing.assert_array_equal(whole, np.concatenate([path(x[i : i + 1]) for i in range(20)]))


def test_moments() -> None:
    x = np.array([[0.0], [0.3], [5.0]])
    draws = np.array([GaussianPath(1, 0.5, 0.01, np.random.default_rng(s))(x) for s in range(4000)])
    expected = matern52(exact_distances(x, x), 0.5) + 0.01 * np.eye(3)
    np.testing.assert_allclose(draws.mean(axis=0), 0.0, atol=4 / np.sqrt(4000))
    np.testing.assert_allclose(np.cov(draws.T), expected, atol=0.08)


def test_same_point_again_gives_the_value_up_to_noise() -> None:
    x = np.full((50, 2), 0.3)
    values = GaussianPath(2, 0.5, 1e-4, np.random.default_rng(4))(x)
    assert values.std() == pytest.approx(0.01, rel=0.4)
    assert GaussianPath(2, 0.5, 0.0, np.random.default_rng(4))(x).std() < 1e-5
