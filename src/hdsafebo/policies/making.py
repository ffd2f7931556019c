"""What a problem of policies is made of: seeds, the space of policies, limits of weights, directions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hdsafebo.errors import ProblemError
from hdsafebo.policies.affine import Normalisation, PolicySpace
from hdsafebo.policies.environments import action_limits
from hdsafebo.policies.features import leading
from hdsafebo.problem import floats
from hdsafebo.typing import FloatArray

_BOX_FACTOR = 1.5  # of the largest initial weight: the search may leave what was drawn, not by much
_BOX_LEAST = 0.03  # for weights that no initial policy uses
_GRID_STEPS = 512  # of a weight's resolution between 0 and its limit, at least
_SHARE = 0.95  # of the variance that main directions explain
_MOST_DIRECTIONS = 12  # a kernel of more has little to say after some hundred trials


def checked_seeds(seeds: Sequence[int]) -> tuple[int, ...]:
    """The seeds as a tuple.

    Raises:
        ProblemError: there is none, one stands twice, or one is no whole number of at least 0.
    """
    given = tuple(seeds)
    if not given or len(set(given)) != len(given):
        raise ProblemError(f"seeds are {given}; expected at least one, all different")
    for seed in given:
        if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
            raise ProblemError(f"seeds are {given}; expected whole numbers, at least 0")
    return tuple(int(seed) for seed in given)


def raw_space(environment: Any, base: ArrayLike | None, unit: ArrayLike | None) -> PolicySpace:
    """The policies of an environment whose observations are taken as they are.

    Args:
        environment: a Gymnasium environment with boxes as spaces.
        base: action of the policy whose weights are all 0, a number or (k,); None takes the middle.
        unit: action per unit of weight, a number or (k,); None takes half the range.

    Raises:
        ProblemError: base or unit has another shape, is not finite, or a unit is not above 0.
    """
    low, high = action_limits(environment)
    values = {
        "base": (low + high) / 2 if base is None else base,
        "unit": (high - low) / 2 if unit is None else unit,
    }
    vectors = {}
    for what, value in values.items():
        try:
            vectors[what] = np.broadcast_to(floats(value, what), low.shape).copy()
        except ValueError:
            raise ProblemError(f"{what} has shape {np.shape(value)}; expected ({len(low)},)") from None
        if not np.isfinite(vectors[what]).all():
            raise ProblemError(f"{what} has values that are not finite")
    if not (vectors["unit"] > 0).all():
        raise ProblemError("unit has values that are not above 0")
    shape = tuple(int(n) for n in environment.observation_space.shape)
    return PolicySpace(
        low,
        high,
        vectors["base"],
        vectors["unit"],
        Normalisation.none(int(np.prod(shape))),
        tuple(int(n) for n in environment.action_space.shape),
        shape,
        str(environment.action_space.dtype),
    )


def checked_effects(effects: ArrayLike | None, space: PolicySpace) -> FloatArray:
    """(q, k) what a unit of weight of each action does; None takes the actions themselves.

    Raises:
        ProblemError: another shape, or values that are not finite.
    """
    given = np.eye(space.actions) if effects is None else floats(effects, "effects")
    if given.ndim != 2 or given.shape[1] != space.actions or not np.isfinite(given).all():
        raise ProblemError(f"effects have shape {given.shape}; expected (q, {space.actions}) finite numbers")
    return given * space.unit


def weight_limits(box: ArrayLike | str, drawn: FloatArray, moves: FloatArray | None = None) -> FloatArray:
    """(2, D) limits of the weights.

    Args:
        box: a number or (D,) numbers, or "design": 1.5 times the largest weights of initial policies, and of
            moves as long as they differ by along any of them; at least 0.03.
        drawn: (n, D) initial policies.
        moves: (r, D) directions that policies are moved along.

    Raises:
        ProblemError: another shape or word, or limits that are not finite and above 0.
    """
    d = drawn.shape[1]
    if isinstance(box, str):
        if box != "design":
            raise ProblemError(f"box is {box!r}; expected a number, ({d},) numbers or 'design'")
        largest = np.abs(drawn).max(axis=0)
        if moves is not None:
            largest = np.maximum(largest, _longest(drawn, moves) * np.abs(moves).max(axis=0))
        limit = np.maximum(_BOX_FACTOR * largest, _BOX_LEAST)
        return np.stack([-limit, limit])
    try:
        limit = np.broadcast_to(floats(box, "box"), (d,))
    except ValueError:
        raise ProblemError(f"box has shape {np.shape(box)}; expected a number or ({d},)") from None
    if not (np.isfinite(limit).all() and (limit > 0).all()):
        raise ProblemError("box has limits that are not finite and above 0")
    return np.stack([-limit, limit])


def _longest(drawn: FloatArray, moves: FloatArray) -> float:
    """How far (n, D) policies lie from their mean along any of (r, D) moves."""
    along = np.linalg.lstsq(moves.T, (drawn - drawn.mean(axis=0)).T, rcond=None)[0]
    return float(np.abs(along).max())


def on_a_grid(limits: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(2, D) symmetric limits, hardly wider, and the (D,) powers of two of which they are whole multiples."""
    resolution = np.exp2(np.ceil(np.log2(limits[1] / _GRID_STEPS)))
    upper = np.ceil(limits[1] / resolution) * resolution
    return np.stack([-upper, upper]), resolution


def main_directions(seen: FloatArray) -> int:
    """How many main directions of (m, o + 1) observations hold 95 % of their second moment; at most 12."""
    values, _ = leading(seen.T @ seen / len(seen), seen.shape[1])
    shares = np.cumsum(values) / values.sum()
    return min(int(np.searchsorted(shares, _SHARE)) + 1, _MOST_DIRECTIONS)
