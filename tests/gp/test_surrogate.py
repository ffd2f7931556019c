"""Several functions together: safe set, margins, thresholds and what fits remember."""

import numpy as np
import pytest

from hdsafebo.gp.surrogate import (
    DistanceCache,
    Surrogate,
    SurrogateState,
    fit_surrogate,
    modelled_safety,
    modelled_thresholds,
)
from hdsafebo.problem import Safety


@pytest.fixture(scope="module")
def surrogate() -> Surrogate:
    rng = np.random.default_rng(0)
    x = rng.random((50, 3))
    safety = np.column_stack([np.cos(4 * x[:, 0]), x[:, 1] - x[:, 2]])
    return fit_surrogate(x, np.sin(3 * x).sum(axis=1), safety, np.array([-0.2, -0.3]))


@pytest.mark.parametrize("beta", [-8.0, -2.0, 0.0, 0.5, 2.0, 16.0])
def test_safe_set_is_where_every_bound_reaches_its_threshold(surrogate: Surrogate, beta: float) -> None:
    x = np.random.default_rng(1).uniform(-0.5, 1.5, (4000, 3))
    mean, deviation = surrogate.predict_safety(x)
    expected = (mean + beta * deviation >= surrogate.thresholds).all(axis=1)
    found = surrogate.believed_safe(x, beta)
    assert 0 < expected.sum() < len(x) or abs(beta) > 4
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(surrogate.slack(x, beta) >= 0, expected)


def test_safe_set_of_no_points(surrogate: Surrogate) -> None:
    assert surrogate.believed_safe(np.empty((0, 3)), 2.0).shape == (0,)


@pytest.mark.parametrize("beta", [-2.0, 2.0])
def test_slack_gradient_is_a_finite_difference(surrogate: Surrogate, beta: float) -> None:
    # Without noise the deviation is a difference of nearly equal numbers: a smaller step shows its rounding.
    x, step = np.random.default_rng(2).random((6, 3)), 1e-4
    slack, gradient = surrogate.slack_with_gradient(x, beta)
    np.testing.assert_allclose(slack, surrogate.slack(x, beta), atol=1e-6)
    for i in range(3):
        shift = step * np.eye(3)[i]
        ends = [surrogate.slack_with_gradient(x + s * shift, beta)[0] for s in (1, -1)]
        np.testing.assert_allclose(gradient[:, i], (ends[0] - ends[1]) / (2 * step), rtol=2e-2, atol=2e-3)


def test_state_survives_json(surrogate: Surrogate) -> None:
    import json

    state = surrogate.state
    assert SurrogateState.from_json(json.loads(json.dumps(state.to_json()))) == state


def test_distances_grown_row_by_row_are_those_computed_at_once() -> None:
    x = np.random.default_rng(3).random((120, 17))
    grown = DistanceCache()
    for n in (1, 40, 41, 90, 120):
        distances = grown.of(x[:n])
    np.testing.assert_array_equal(distances, DistanceCache().of(x))
    np.testing.assert_array_equal(grown.of(x[::-1]), DistanceCache().of(x[::-1]))
    np.testing.assert_array_equal(grown.of(x[:10]), DistanceCache().of(x[:10]))


def test_transform_moves_values_and_threshold() -> None:
    functions = (
        Safety("a", 0.05, transform=lambda g: np.log(g + 0.005)),
        Safety("b", 4.4, modelled=False),
        Safety("c", 1.0, reported=False),
    )
    values = np.array([[0.1, 4.0, 0.5], [0.2, 5.0, 2.0]])
    np.testing.assert_allclose(
        modelled_safety(functions, values), [[np.log(0.105), 0.5], [np.log(0.205), 2.0]]
    )
    np.testing.assert_allclose(modelled_thresholds(functions), [np.log(0.055), 1.0])


def test_threshold_beyond_an_outlier_keeps_its_side() -> None:
    """Values are drawn in beyond twenty scales; the threshold is drawn in with them."""
    x = np.random.default_rng(4).random((20, 2))
    safety = np.append(np.random.default_rng(5).normal(size=19), -1e12)[:, None]
    surrogate = fit_surrogate(x, x[:, 0], safety, np.array([-1e6]))
    drawn = surrogate.safety[0].outcomes.restore(surrogate.safety[0].values)
    assert drawn[19] < surrogate.thresholds[0] < drawn[:19].min()
