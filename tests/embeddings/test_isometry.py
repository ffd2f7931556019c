"""The check as a whole, and its floors."""

from dataclasses import replace

import numpy as np
import pytest

from hdsafebo.embeddings import make_embedding
from hdsafebo.embeddings.base import Embedding
from hdsafebo.embeddings.distances import Rows, sample_pairs
from hdsafebo.embeddings.isometry import IsometryCheck, IsometryMeasures, RoundTrip
from hdsafebo.errors import IsometryError

X = np.random.default_rng(0).standard_normal((120, 8)) * [5, 4, 3, 2, 1, 1, 1, 1]


def nearest(points: np.ndarray) -> tuple[Rows, np.ndarray]:
    distances = np.linalg.norm(points[:, None] - X[None], axis=2)
    return distances.argmin(axis=1), distances.min(axis=1)


@pytest.fixture(scope="module")
def check() -> IsometryCheck:
    whole = RoundTrip(X, np.arange(120), nearest)
    half = RoundTrip(X[::2], np.arange(120)[::2], nearest)
    pairs = sample_pairs(120, 2000, np.random.default_rng(1))
    return IsometryCheck(X, pairs, whole, half, half, gp_points=60, gp_draws=4, jacobian_points=5, seed=0)


def embedding(name: str, **settings: object) -> Embedding:
    return make_embedding(name, **settings).fit(X, rng=np.random.default_rng(2))


def test_identity_passes_perfectly(check: IsometryCheck) -> None:
    measures, latent = check.measure(embedding("identity"))
    np.testing.assert_allclose(latent, check.original_distances)
    assert measures.distance_correlation == pytest.approx(1.0)
    assert measures.scale == pytest.approx(1.0)
    assert (measures.gp_mean_difference, measures.gp_variance_difference) == (0.0, 0.0)
    assert (measures.round_trip, measures.round_trip_held_out, measures.round_trip_held_out_currents) == (
        1,
        1,
        1,
    )
    assert measures.reconstruction_mse == 0.0
    assert measures.condition_number == pytest.approx(1.0)


def test_fewer_components_measure_worse(check: IsometryCheck) -> None:
    many, few = (check.measure(embedding("pca", latent_dim=d))[0] for d in (6, 2))
    assert 1 > many.distance_correlation > few.distance_correlation > 0.5
    assert 0 < many.gp_mean_difference < few.gp_mean_difference
    assert 0 < many.gp_variance_difference < few.gp_variance_difference
    assert many.round_trip > few.round_trip
    assert many.reconstruction_mse < few.reconstruction_mse


def test_a_lost_direction_has_no_condition_number(check: IsometryCheck) -> None:
    blind = embedding("pca", latent_dim=3)
    tensors = {key: value.copy() for key, value in blind.tensors().items()}
    tensors["decoder"][:, 2] = 0.0
    blind._restore(tensors)
    assert check.measure(blind)[0].condition_number is None


def test_same_seed_same_measures(check: IsometryCheck) -> None:
    assert (
        check.measure(embedding("random", latent_dim=3))[0]
        == check.measure(embedding("random", latent_dim=3))[0]
    )


def test_floors_let_pass_what_reaches_them(check: IsometryCheck) -> None:
    check.measure(embedding("pca", latent_dim=6))[0].require(
        "pca", {"distance_correlation": 0.9, "round_trip": 0.5}
    )


def test_below_a_floor_the_error_gives_value_floor_and_override() -> None:
    measures = IsometryMeasures(0.71, 1.0, 0.1, 0.1, 0.4, 0.3, 0.2, 0.01, 2.0)
    floors = {"distance_correlation": 0.9729, "round_trip": 0.99, "round_trip_held_out": 0.3}
    with pytest.raises(IsometryError) as caught:
        measures.require("vae", floors)
    message = str(caught.value)
    assert "distance_correlation is 0.7100, its floor 0.9729" in message
    assert "round_trip is 0.4000, its floor 0.99" in message
    assert (
        "isometry.floors.vae.distance_correlation and isometry.floors.vae.round_trip in params.yaml"
        in message
    )
    assert "held_out" not in message


def test_not_a_number_is_below_every_floor() -> None:
    measures = IsometryMeasures(0.9, 1.0, 0.1, 0.1, 0.4, 0.3, 0.2, 0.01, 2.0)
    with pytest.raises(IsometryError):
        replace(measures, distance_correlation=float("nan")).require("pca", {"distance_correlation": 0.0})
