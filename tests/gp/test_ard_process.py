"""Posterior against the textbook formulas, its gradient against differences, samples against moments."""

import numpy as np
import pytest

from hdsafebo.gp.ard import BOTORCH_DEFAULT, TRUST_REGION, ArdFit, ArdModel, correlation
from hdsafebo.gp.ard_process import ArdProcess, BelievedPool

FIT = ArdFit(np.array([0.4, 0.9, 2.0]), 1e-3, 1.7, 0.1, 0.0)


def process(model: ArdModel, n: int = 25) -> ArdProcess:
    rng = np.random.default_rng(0)
    x = rng.random((n, 3))
    return ArdProcess(x, 5 + 3 * np.sin(4 * x[:, 0]) + x[:, 1], model, fit=FIT)


def dense(gp: ArdProcess, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    def k(a, b):
        squared = (((a[:, None] - b) / FIT.length_scales) ** 2).sum(-1)
        return FIT.scale * correlation(squared, gp.model.kernel)

    v = (gp.y - gp.y.mean()) / gp.y.std(ddof=1)
    inverse = np.linalg.inv(k(gp.x, gp.x) + FIT.noise * np.eye(len(gp.x)))
    cross = k(q, gp.x)
    mean = FIT.mean + cross @ inverse @ (v - FIT.mean)
    return gp.y.mean() + gp.y.std(ddof=1) * mean, gp.y.std(ddof=1) ** 2 * (
        k(q, q) - cross @ inverse @ cross.T
    )


@pytest.mark.parametrize("model", [BOTORCH_DEFAULT, TRUST_REGION])
def test_posterior(model: ArdModel) -> None:
    gp, q = process(model), np.random.default_rng(1).random((7, 3))
    mean, covariance = dense(gp, q)
    np.testing.assert_allclose(gp.predict(q), [mean, np.sqrt(np.diag(covariance))], rtol=1e-6)


@pytest.mark.parametrize("model", [BOTORCH_DEFAULT, TRUST_REGION])
def test_gradient(model: ArdModel) -> None:
    gp, q, e = process(model), np.random.default_rng(1).random((4, 3)), 1e-6
    mean, sd, pullback = gp.predict_with_pullback(q)
    d_mean, d_sd = pullback(np.ones(4), np.zeros(4)), pullback(np.zeros(4), np.ones(4))
    np.testing.assert_allclose([mean, sd], gp.predict(q), rtol=1e-8)
    for j in range(3):
        step = e * np.eye(3)[j]
        up, down = gp.predict(q + step), gp.predict(q - step)
        np.testing.assert_allclose(d_mean[:, j], (up[0] - down[0]) / (2 * e), rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(d_sd[:, j], (up[1] - down[1]) / (2 * e), rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("model", [BOTORCH_DEFAULT, TRUST_REGION])
def test_paths_have_the_moments_of_the_posterior(model: ArdModel) -> None:
    gp, rng = process(model), np.random.default_rng(2)
    q = np.random.default_rng(1).random((6, 3))
    mean, covariance = dense(gp, q)
    # Paths of one call share their features; only many calls average the feature error out.
    samples = np.vstack([gp.paths(q, 40, rng) for _ in range(100)])
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((samples.mean(0) - mean) / scale, 0, atol=0.08)
    relative = (np.cov(samples.T) - covariance) / np.outer(scale, scale)
    np.testing.assert_allclose(relative, 0, atol=0.12)


def test_belief_leaves_the_mean_and_shrinks_the_deviation() -> None:
    gp, q = process(TRUST_REGION), np.random.default_rng(1).random((3, 3))
    more = gp.believing(q)
    probe = np.random.default_rng(3).random((20, 3))
    np.testing.assert_allclose(more.predict(probe)[0], gp.predict(probe)[0], rtol=1e-6)
    assert (more.predict(probe)[1] <= gp.predict(probe)[1] + 1e-9).all()
    assert (more.predict(q)[1] < 0.1 * gp.unit).all()


def test_pool_follows_the_beliefs() -> None:
    gp, rng = process(BOTORCH_DEFAULT), np.random.default_rng(1)
    points, q = rng.random((20, 3)), rng.random((3, 3))
    pool, more = BelievedPool(gp, points), gp
    for point in q:
        more = more.believing(point[None])
        pool.follow(more)
    np.testing.assert_allclose([pool.mean, pool.sd], more.predict(points), rtol=1e-6)
    np.testing.assert_allclose(pool.sd, gp.believing(q).predict(points)[1], rtol=1e-6)


def test_paths_around_a_centre_are_the_same_paths() -> None:
    rng = np.random.default_rng(0)
    x, d = rng.random((25, 40)), 40
    gp = ArdProcess(x, np.sin(4 * x[:, 0]), TRUST_REGION, fit=ArdFit(np.full(d, 2.0), 1e-3, 1.7, 0.1, 0.0))
    q = np.tile(x[0], (30, 1))
    q[np.arange(30), np.arange(30)] = rng.random(30)
    dense, sparse = (gp.paths(q, 4, np.random.default_rng(5), centre) for centre in (None, x[0]))
    np.testing.assert_allclose(sparse, dense, rtol=1e-9)


def test_constant_outcomes_and_one_point_are_admissible() -> None:
    x = np.random.default_rng(0).random((10, 3))
    mean, sd = ArdProcess(x, np.full(10, 4.0), TRUST_REGION).predict(x)
    np.testing.assert_allclose(mean, 4.0)
    assert np.isfinite(sd).all()
    assert np.isfinite(ArdProcess(x[:1], np.array([2.0]), BOTORCH_DEFAULT).predict(x)).all()


def test_thirty_equal_points_are_admissible() -> None:
    rng = np.random.default_rng(0)
    gp = ArdProcess(np.full((30, 3), 0.5), rng.standard_normal(30), TRUST_REGION)
    assert np.isfinite(gp.predict(rng.random((5, 3)))).all()
