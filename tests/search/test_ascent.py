"""Ascent under a constraint against the known maximum."""

import numpy as np
import pytest

from hdsafebo.search.ascent import ascend
from hdsafebo.search.metric import Metric

PLAIN = Metric(np.ones(3), np.zeros(3))
CENTRE = np.full(3, 0.5)


def quadratic(top: np.ndarray):
    return lambda k: (-((k - top) ** 2).sum(axis=1), -2 * (k - top))


def half_space(normal: np.ndarray, offset: float):
    return lambda k: (k @ normal - offset, np.tile(normal, (len(k), 1)))


ALL = half_space(np.zeros(3), -1.0)


def starts(n: int) -> np.ndarray:
    return CENTRE + 0.01 * np.random.default_rng(0).standard_normal((n, 3))


def test_reaches_a_maximum_within_the_ball() -> None:
    top = CENTRE + np.array([0.05, -0.05, 0.02])
    best, found = ascend(quadratic(top), ALL, starts(3), CENTRE, np.full(3, 0.3), PLAIN, 40)
    assert found.all()
    np.testing.assert_allclose(best, np.tile(top, (3, 1)), atol=0.02)


def test_stops_at_the_ball_and_at_the_cube() -> None:
    radius = np.array([0.1, 0.2])
    best, _ = ascend(quadratic(CENTRE + np.array([5.0, 0, 0])), ALL, starts(2), CENTRE, radius, PLAIN, 40)
    np.testing.assert_allclose(best[:, 0] - 0.5, radius, rtol=0.02)
    best, _ = ascend(
        quadratic(CENTRE + np.array([5.0, 0, 0])), ALL, starts(1), CENTRE, np.array([9.0]), PLAIN, 40
    )
    assert best.max() <= 1.0
    assert best[0, 0] > 0.99


def test_slides_along_the_border_of_the_safe_set() -> None:
    """Maximum of a quadratic over a half space: the projection of its top onto the border."""
    normal = np.array([-1.0, 0.0, 0.0])
    safe = half_space(normal, -0.55)  # x_0 <= 0.55
    top = np.array([0.8, 0.6, 0.45])
    best, found = ascend(quadratic(top), safe, starts(4), CENTRE, np.full(4, 0.3), PLAIN, 60)
    assert found.all()
    assert (best[:, 0] <= 0.55 + 1e-12).all()
    assert (-((best - top) ** 2).sum(axis=1) > -(0.25**2) - 0.01).all()


def test_returns_into_the_safe_set_from_outside() -> None:
    safe = half_space(np.array([1.0, 0.0, 0.0]), 0.6)  # the centre is not safe
    best, found = ascend(quadratic(CENTRE), safe, starts(2), CENTRE, np.full(2, 0.3), PLAIN, 40)
    assert found.all()
    assert (best[:, 0] >= 0.6).all()


def test_says_when_nothing_safe_was_met() -> None:
    never = half_space(np.zeros(3), 1.0)
    _, found = ascend(quadratic(CENTRE), never, starts(2), CENTRE, np.full(2, 0.3), PLAIN, 10)
    assert not found.any()


@pytest.mark.parametrize(
    "matrix", [np.array([2.0, 0.5, 1.0]), np.array([[2.0, 0, 0.1], [0, 0.5, 0], [0, 0, 1], [1, 1, 0]])]
)
def test_metric_measures_in_kernel_inputs(matrix: np.ndarray) -> None:
    metric = Metric(matrix, np.zeros(len(matrix)))
    dense = np.diag(matrix) if matrix.ndim == 1 else matrix
    u = np.random.default_rng(1).random((5, 3))
    np.testing.assert_allclose(metric.inputs(u), u @ dense.T)
    np.testing.assert_allclose(metric.length(u)[:, 0], np.linalg.norm(u @ dense.T, axis=1))
    np.testing.assert_allclose(metric.length(metric.normalised(u)), 1.0)
    gradient = np.random.default_rng(2).random((5, len(dense)))
    np.testing.assert_allclose(metric.pull_back(gradient), gradient @ dense)
    top = metric.inputs(CENTRE[None])[0] + 0.05
    radius = np.full(2, 0.2)
    best, _ = ascend(
        quadratic(top), half_space(np.zeros(len(dense)), -1.0), starts(2), CENTRE, radius, metric, 40
    )
    assert (metric.length(best - CENTRE)[:, 0] <= 0.2 + 1e-9).all()


def test_directions_are_hidden_when_no_kernel_input_changes() -> None:
    assert not Metric(np.array([1.0, 0.0, 2.0]), np.zeros(3)).hides_directions  # the second does not vary
    assert not Metric(np.eye(3)[:, [0, 1, 2, 2]] * [1, 1, 1, 0], np.zeros(3)).hides_directions
    assert Metric(np.array([[1.0, -1.0, 0.0], [0.0, 0.0, 1.0]]), np.zeros(2)).hides_directions
