"""Standardisation: ordinary data, outliers, constants."""

import numpy as np
import pytest

from hdsafebo.gp.outcomes import Outcomes, normal_scores


def test_scale_is_that_of_the_central_values() -> None:
    y = np.random.default_rng(0).normal(3.0, 2.0, 1000)
    outcomes = Outcomes.of(y)
    central = np.sort(y)[50:950]
    np.testing.assert_allclose((outcomes.centre, outcomes.scale), (central.mean(), central.std()))
    np.testing.assert_allclose(outcomes.restore(outcomes.standardise(y)), y)


def test_absurd_value_neither_flattens_nor_reorders() -> None:
    y = np.append(np.random.default_rng(1).normal(size=50), [1e12, 2e12])
    v = Outcomes.of(y).standardise(y)
    np.testing.assert_array_equal(np.argsort(v), np.argsort(y))
    assert np.std(v[:50]) > 0.5
    assert v.max() < 60


def test_drawing_in_is_continuous_and_increasing() -> None:
    outcomes = Outcomes(0.0, 1.0)
    y = np.linspace(-40, 40, 100_001)
    v = outcomes.standardise(y)
    assert (np.diff(v) > 0).all()
    assert np.diff(v).max() < 1e-3
    np.testing.assert_allclose(v, -v[::-1], atol=1e-12)


@pytest.mark.parametrize("y", [[5.0], [5.0] * 30, [0.0] * 3, [1e300] * 4, [1e-300, 1e-300]])
def test_constants_have_scale_one(y: list[float]) -> None:
    outcomes = Outcomes.of(np.array(y))
    assert outcomes.scale == 1.0
    np.testing.assert_allclose(outcomes.standardise(np.array(y)), 0.0, atol=1e-12)


def test_rare_class_sets_the_scale_when_the_rest_is_constant() -> None:
    y = np.array([0.0] * 97 + [4.4] * 3)
    assert Outcomes.of(y).scale == pytest.approx(y.std())


def test_normal_scores_are_normal_and_keep_the_order() -> None:
    y = np.append(np.random.default_rng(2).lognormal(0.0, 3.0, 999), 1e300)
    scores = normal_scores(y)
    np.testing.assert_array_equal(np.argsort(scores), np.argsort(y))
    assert scores.mean() == pytest.approx(0.0, abs=1e-9)
    assert scores.std() == pytest.approx(1.0, abs=0.01)


def test_equal_values_have_equal_normal_scores() -> None:
    np.testing.assert_array_equal(normal_scores(np.full(5, 3.0)), 0.0)
    low, high, tied = normal_scores(np.array([1.0, 2.0, 2.0]))[[0, 1, 2]]
    assert low < high == tied
