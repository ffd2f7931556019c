"""Measures of distance preservation against closed forms."""

import numpy as np
import pytest
from scipy.spatial.distance import pdist
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import Matern

from hdsafebo.embeddings import make_embedding
from hdsafebo.embeddings.base import Embedding
from hdsafebo.embeddings.distances import (
    condition_number,
    decoder_jacobian,
    distance_correlation,
    distance_scale,
    gp_differences,
    pair_distances,
    reconstruction_mse,
    sample_pairs,
)
from hdsafebo.errors import DatasetError

RNG = np.random.default_rng(0)
X = RNG.standard_normal((200, 6))
ISOMETRY = 3.0 * np.linalg.qr(RNG.standard_normal((6, 6)))[0]


def linear_embedding(decoder: np.ndarray) -> Embedding:
    """x = D z, encoded by the pseudo-inverse."""
    embedding = make_embedding("random", latent_dim=decoder.shape[1])
    embedding.fit(np.zeros((10, len(decoder))), rng=np.random.default_rng(0))
    embedding._restore(
        {"mean": np.zeros(len(decoder)), "encoder": np.linalg.pinv(decoder), "decoder": decoder}
    )
    return embedding


def test_pairs_are_of_different_points_and_cover_them() -> None:
    pairs = sample_pairs(50, 5000, np.random.default_rng(1))
    assert pairs.shape == (2, 5000)
    assert (pairs[0] != pairs[1]).all()
    assert len(np.unique(pairs)) == 50
    with pytest.raises(DatasetError, match="at least 2 points, got 1"):
        sample_pairs(1, 5, np.random.default_rng(1))


def test_distances_are_those_of_the_pairs() -> None:
    pairs = sample_pairs(200, 9000, np.random.default_rng(2))
    expected = [np.sqrt(((X[a] - X[b]) ** 2).sum()) for a, b in pairs.T]
    np.testing.assert_allclose(pair_distances(X, pairs), expected)


def test_scaled_isometry_has_correlation_one_and_its_scale() -> None:
    pairs = sample_pairs(200, 1000, np.random.default_rng(3))
    original, latent = pair_distances(X, pairs), pair_distances(X @ ISOMETRY + 5, pairs)
    assert distance_correlation(original, latent) == pytest.approx(1.0)
    assert distance_scale(original, latent) == pytest.approx(3.0)


def test_constant_codes_have_no_correlation() -> None:
    assert distance_correlation(np.arange(5.0), np.zeros(5)) == 0.0


def test_scaled_isometry_leaves_the_gaussian_process_alone() -> None:
    differences = gp_differences(X, X @ ISOMETRY, 3.0, np.random.default_rng(4), train=100, draws=5)
    assert max(differences) < 1e-10


def test_gaussian_process_differences_are_those_of_scikit_learn() -> None:
    """Variances to rounding; means in expectation, since what is drawn has a known covariance."""
    x, z, train = X[:60], X[:60, :2], 30
    length = np.median(pdist(x))
    gain, variance, prior = [], [], Matern(length, nu=2.5)(x)
    for points in (x, z):
        process = GaussianProcessRegressor(Matern(length, nu=2.5), alpha=1e-2, optimizer=None)
        process.fit(points[:train], np.eye(train))
        mean, deviation = process.predict(points[train:], return_std=True)
        gain.append(mean)  # the posterior mean of unit vectors: the weights of the values
        variance.append(deviation[:, 0] ** 2)
    observed = prior[:train, :train] + 1e-2 * np.eye(train)
    change = gain[0] - gain[1]
    expected = np.sqrt(2 / np.pi * np.einsum("ij,jk,ik->i", change, observed, change)).mean()
    mean_difference, variance_difference = gp_differences(
        x, z, 1.0, np.random.default_rng(5), train=train, draws=20_000
    )
    assert variance_difference == pytest.approx(np.abs(variance[0] - variance[1]).mean(), rel=1e-8)
    assert mean_difference == pytest.approx(expected, rel=0.01)


def test_condition_number_is_that_of_the_pullback_metric() -> None:
    decoder = np.linalg.qr(RNG.standard_normal((9, 3)))[0] @ np.diag([2.0, 1.0, 0.5])
    embedding = linear_embedding(decoder)
    z = RNG.standard_normal((7, 3))
    np.testing.assert_allclose(decoder_jacobian(embedding, z), np.tile(decoder, (7, 1, 1)), atol=1e-9)
    assert condition_number(embedding, z) == pytest.approx(np.linalg.cond(decoder.T @ decoder), rel=1e-6)
    assert condition_number(embedding, np.zeros((2, 3))) == pytest.approx(16.0, rel=1e-6)


def test_condition_number_of_an_isometry_is_one_and_of_a_lost_direction_infinite() -> None:
    basis = np.linalg.qr(RNG.standard_normal((9, 3)))[0]
    z = RNG.standard_normal((4, 3))
    assert condition_number(linear_embedding(7.0 * basis), z) == pytest.approx(1.0, abs=1e-8)
    assert condition_number(linear_embedding(basis * [1.0, 1.0, 0.0]), z) == np.inf


def test_reconstruction_error_is_per_component() -> None:
    basis = np.eye(4)[:, :2]
    assert reconstruction_mse(linear_embedding(basis), np.array([[1.0, 1.0, 2.0, 0.0]])) == pytest.approx(1.0)
