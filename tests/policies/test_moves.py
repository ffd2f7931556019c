"""Directions in which initial policies differ, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.errors import ProblemError
from hdsafebo.policies.affine import Normalisation, PolicySpace
from hdsafebo.policies.making import checked_effects
from hdsafebo.policies.moves import behaviours, main_moves, move_features

EFFECTS = np.random.default_rng(5).normal(size=(6, 4))
"""Of four actions."""


@pytest.fixture
def seen() -> np.ndarray:
    """Normalised observations of two numbers, and the constant."""
    return np.column_stack([np.random.default_rng(0).normal(size=(50, 2)), np.ones(50)])


def test_distances_of_behaviours_are_root_mean_squares_of_what_actions_do(seen: np.ndarray) -> None:
    rng = np.random.default_rng(1)
    effects, (a, b) = rng.normal(size=(3, 4)), rng.normal(size=(2, 12))
    difference = seen @ (effects @ (a - b).reshape(4, 3)).T
    left, right = behaviours(np.stack([a, b]), effects, seen)
    assert np.linalg.norm(left - right) == pytest.approx(np.sqrt(np.mean(np.sum(difference**2, axis=1))))


def test_main_moves_span_what_two_numbers_draw_and_no_more(seen: np.ndarray) -> None:
    rng = np.random.default_rng(2)
    span = rng.normal(size=(2, 12))
    drawn = rng.normal(size=(20, 2)) * [3.0, 1.0] @ span + 5.0
    moves = main_moves(drawn, EFFECTS, seen, 5)
    assert moves.shape == (2, 12)
    assert np.linalg.matrix_rank(np.concatenate([span, moves])) == 2
    changes = behaviours(moves, EFFECTS, seen)
    np.testing.assert_allclose(changes @ changes.T, np.eye(2), atol=1e-9)
    along = behaviours(drawn - drawn.mean(axis=0), EFFECTS, seen) @ changes.T
    assert along[:, 0].std() > along[:, 1].std()
    assert along[:, 0] @ along[:, 1] == pytest.approx(0.0, abs=1e-9)


def test_features_are_coordinates_along_moves_and_their_steps_are_the_moves() -> None:
    rng = np.random.default_rng(4)
    moves, width = rng.normal(size=(3, 12)), rng.uniform(0.1, 10.0, 12)
    features = move_features(moves, width)
    codes = rng.normal(size=(5, 3))
    np.testing.assert_allclose(features(codes @ moves), codes, atol=1e-9)
    in_the_cube = features.matrix * width
    shortest = np.linalg.pinv(in_the_cube).T * width  # (3, 12): the least steps in the cube, as weights
    np.testing.assert_allclose(shortest, moves, atol=1e-9)


def test_effects_are_of_a_unit_of_weight() -> None:
    space = PolicySpace(
        np.full(2, -4.0),
        np.full(2, 4.0),
        np.zeros(2),
        np.array([1.0, 3.0]),
        Normalisation.none(2),
        (2,),
        (2,),
    )
    np.testing.assert_array_equal(checked_effects(None, space), [[1.0, 0.0], [0.0, 3.0]])
    np.testing.assert_array_equal(checked_effects([[1.0, 2.0]], space), [[1.0, 6.0]])


def test_what_has_no_moves_is_refused(seen: np.ndarray) -> None:
    with pytest.raises(ProblemError, match="moves is 0; expected 1 to 3"):
        main_moves(np.zeros((4, 12)), EFFECTS, seen, 0)
    with pytest.raises(ProblemError, match="do the same"):
        main_moves(np.ones((4, 12)), EFFECTS, seen, 2)
