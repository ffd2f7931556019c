"""Closed-form embeddings against what they must be."""

import numpy as np
import pytest
from sklearn.decomposition import PCA as ScikitPCA

from hdsafebo.embeddings import make_embedding
from hdsafebo.errors import DatasetError, EmbeddingTrainingError

X = np.random.default_rng(0).standard_normal((60, 4)) @ np.random.default_rng(1).standard_normal((4, 12)) + 3


def test_pca_is_scikit_learns() -> None:
    embedding = make_embedding("pca", latent_dim=3).fit(X, rng=np.random.default_rng(0))
    expected = ScikitPCA(n_components=3).fit(X)
    np.testing.assert_allclose(embedding.encode(X), expected.transform(X), atol=1e-12)
    z = np.random.default_rng(2).standard_normal((5, 3))
    np.testing.assert_allclose(embedding.decode(z), expected.inverse_transform(z), atol=1e-12)


def test_pca_of_the_full_rank_keeps_points_and_distances() -> None:
    embedding = make_embedding("pca", latent_dim=4).fit(X, rng=np.random.default_rng(0))
    z = embedding.encode(X)
    np.testing.assert_allclose(embedding.decode(z), X, atol=1e-10)
    np.testing.assert_allclose(
        np.linalg.norm(z[1:] - z[:-1], axis=1), np.linalg.norm(X[1:] - X[:-1], axis=1), atol=1e-10
    )


def test_pca_is_reproducible_where_scikit_learn_draws_at_random() -> None:
    wide = np.random.default_rng(4).standard_normal((150, 1200))
    first, second = (
        make_embedding("pca", latent_dim=5).fit(wide, rng=np.random.default_rng(5)) for _ in "ab"
    )
    np.testing.assert_array_equal(first.encode(wide), second.encode(wide))


def test_random_projection_inverts_itself_on_codes_and_keeps_squared_distances_on_average() -> None:
    rng = np.random.default_rng(6)
    x = rng.standard_normal((40, 200))
    ratios = []
    for _ in range(60):
        embedding = make_embedding("random", latent_dim=16).fit(x, rng=rng)
        z = embedding.encode(x)
        np.testing.assert_allclose(embedding.encode(embedding.decode(z)), z, atol=1e-10)
        ratios.append(np.sum((z[1:] - z[:-1]) ** 2) / np.sum((x[1:] - x[:-1]) ** 2))
    # each ratio has mean 1 and a standard deviation below sqrt(2/16)
    assert np.mean(ratios) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 16 / 60))


def test_identity_keeps_everything() -> None:
    embedding = make_embedding("identity").fit(X, rng=np.random.default_rng(0))
    assert embedding.latent_dim == embedding.input_dim == 12
    np.testing.assert_array_equal(embedding.encode(X), X)
    np.testing.assert_array_equal(embedding.decode(X), X)


@pytest.mark.parametrize("name", ["pca", "random"])
def test_source_varies_the_points(name: str) -> None:
    embedding = make_embedding(name, latent_dim=2).fit(
        X, rng=np.random.default_rng(0), source=lambda x, rng: x + 7
    )
    np.testing.assert_allclose(embedding.encode(X.mean(axis=0, keepdims=True) + 7), 0.0, atol=1e-10)


@pytest.mark.parametrize("name", ["identity", "pca", "random"])
def test_bad_arrays_are_refused(name: str) -> None:
    embedding = make_embedding(name)
    with pytest.raises(EmbeddingTrainingError, match="not fitted"):
        embedding.encode(X)
    with pytest.raises(DatasetError, match=r"x has shape \(12,\)"):
        embedding.fit(X[0], rng=np.random.default_rng(0))
    with pytest.raises(DatasetError, match="x holds NaN"):
        embedding.fit(np.full((60, 20), np.nan), rng=np.random.default_rng(0))
    embedding.fit(np.random.default_rng(7).standard_normal((60, 20)), rng=np.random.default_rng(0))
    with pytest.raises(DatasetError, match=r"x has shape \(60, 12\), expected \(n, 20\)"):
        embedding.encode(X)
    with pytest.raises(DatasetError, match=r"z has shape \(2, 3\), expected"):
        embedding.decode(np.zeros((2, 3)))
    with pytest.raises(DatasetError, match="infinite"):
        embedding.decode(np.full((2, embedding.latent_dim), np.inf))


def test_too_few_points_are_refused() -> None:
    with pytest.raises(DatasetError, match="at least 16 points"):
        make_embedding("pca").fit(X, rng=np.random.default_rng(0))
