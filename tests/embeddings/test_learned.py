"""The learned embeddings on a curved sheet: they must learn it, repeat to the bit, and fail loudly."""

from pathlib import Path

import numpy as np
import pytest

from hdsafebo.embeddings import Embedding, load_embedding, make_embedding
from hdsafebo.errors import EmbeddingTrainingError

SMALL = {"latent_dim": 2, "hidden": 32, "layers": 2, "batch_size": 64, "epochs": 40, "patience": 40}
LEARNED = ["irvae", "vae", "residual"]
AUTOENCODERS = ["irvae", "vae"]


def sheet(count: int, seed: int = 0) -> np.ndarray:
    """A curved two-dimensional sheet in 12 dimensions, with a large offset and a small spread."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1, 1, (count, 2))
    curved = np.column_stack([u, 0.3 * u**2, 0.3 * u[:, 0] * u[:, 1]])
    rotation = np.linalg.qr(np.random.default_rng(99).standard_normal((12, 12)))[0]
    return 5.0 + 0.05 * curved @ rotation[:5]


def fitted(name: str, **changes: object) -> Embedding:
    return make_embedding(name, **{**SMALL, **changes}).fit(sheet(800), rng=np.random.default_rng(3))


def unexplained(embedding: Embedding, x: np.ndarray) -> float:
    error = embedding.decode(embedding.encode(x)) - x
    return float((error**2).sum() / ((x - x.mean(axis=0)) ** 2).sum())


def distance_correlation(embedding: Embedding, x: np.ndarray) -> float:
    z = embedding.encode(x)
    pairs = np.random.default_rng(4).integers(len(x), size=(2, 4000))
    return float(np.corrcoef(*(np.linalg.norm(t[pairs[0]] - t[pairs[1]], axis=1) for t in (x, z)))[0, 1])


@pytest.mark.parametrize("name", LEARNED)
def test_learns_more_than_its_principal_components(name: str) -> None:
    fresh = sheet(500, seed=7)
    linear = make_embedding("pca", latent_dim=2).fit(sheet(800), rng=np.random.default_rng(0))
    assert unexplained(fitted(name), fresh) < 0.7 * unexplained(linear, fresh)


@pytest.mark.parametrize("name", LEARNED)
def test_same_seed_same_files(name: str, tmp_path: Path) -> None:
    paths = [tmp_path / "a.safetensors", tmp_path / "b.safetensors"]
    for path in paths:
        fitted(name, epochs=10).save(path)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert paths[0].with_suffix(".json").read_bytes() == paths[1].with_suffix(".json").read_bytes()


@pytest.mark.parametrize("name", LEARNED)
def test_loaded_equals_saved(name: str, tmp_path: Path) -> None:
    embedding, x = fitted(name, epochs=10), sheet(20)
    embedding.save(tmp_path / "e.safetensors")
    loaded = load_embedding(tmp_path / "e.safetensors", input_dim=12, latent_dim=2)
    np.testing.assert_array_equal(loaded.encode(x), embedding.encode(x))
    np.testing.assert_array_equal(loaded.decode(loaded.encode(x)), embedding.decode(embedding.encode(x)))
    assert loaded.training == embedding.training


def test_isometry_term_preserves_distances() -> None:
    fresh = sheet(400, seed=8)
    regularised = distance_correlation(fitted("irvae"), fresh)
    assert regularised > 0.99


def test_early_stop_keeps_the_best_weights() -> None:
    embedding = fitted("vae", epochs=400, patience=2, learning_rate=1e-2)
    history = embedding.training["unexplained"]
    assert embedding.training["stopped_early"]
    assert len(history) == embedding.training["best_epoch"] + 2
    assert min(history) == history[embedding.training["best_epoch"] - 1]


@pytest.mark.parametrize("name", AUTOENCODERS)
def test_collapse_is_an_error_that_says_what_to_do(name: str) -> None:
    with pytest.raises(
        EmbeddingTrainingError, match=rf"'{name}' collapsed: .*expected at most 80%; set warm_start"
    ):
        fitted(name, warm_start_epochs=0, decoder_sigma=1000.0, epochs=1)


@pytest.mark.parametrize("name", LEARNED)
def test_divergence_is_an_error_that_says_what_to_do(name: str) -> None:
    with pytest.raises(EmbeddingTrainingError, match=r"(diverged|collapsed).*set .*learning_rate"):
        fitted(name, learning_rate=1e30, epochs=5)


def test_residual_gives_codes_back_exactly() -> None:
    embedding = fitted("residual", epochs=2)
    z = np.random.default_rng(5).standard_normal((50, 2))
    np.testing.assert_allclose(embedding.encode(embedding.decode(z)), z, atol=1e-12)


def test_homogeneous_residual_decodes_rays_from_the_origin_to_rays() -> None:
    rays = 1.0 + np.linspace(0.1, 1.0, 800)[:, None] * (sheet(800) - 4.0)
    embedding = make_embedding("residual", **SMALL, homogeneous=True, origin=1.0)
    embedding.fit(rays, rng=np.random.default_rng(0))
    z = embedding.encode(rays[:10])
    np.testing.assert_allclose(embedding.decode(0.3 * z) - 1, 0.3 * (embedding.decode(z) - 1), atol=1e-12)
    np.testing.assert_array_equal(embedding.decode(np.zeros((1, 2))), np.ones((1, 12)))
    assert unexplained(embedding, rays) < 1e-3


def test_source_is_drawn_anew_each_epoch() -> None:
    calls = []

    def source(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        calls.append(len(x))
        return x * rng.uniform(0.9, 1.1, (len(x), 1))

    embedding = make_embedding("vae", **{**SMALL, "epochs": 40, "warm_start_epochs": 20, "batch_size": 10})
    embedding.fit(sheet(100), rng=np.random.default_rng(0), source=source)
    # scale and held-out points once, principal components, twenty warm epochs and forty, the box of all codes
    assert calls == [90, 10, 90, *[90] * 60, 100]
