"""The main ways in which initial policies differ, as what the kernel sees of policies.

Of thousands of weights nearly every step is noise: it changes a little of everything. Where the initial
policies come from few numbers, as reflexes come from their gains, the directions in which they differ are
those along which policies are known to be worth changing, and nothing else is known of all others.

Two policies lie as far apart along these directions as what their actions do differs (forces, joint torques),
in the root mean square over recorded observations.
"""

from __future__ import annotations

import numpy as np

from hdsafebo.errors import ProblemError
from hdsafebo.policies.features import leading
from hdsafebo.problem import LinearFeatures
from hdsafebo.typing import FloatArray

_DEPENDENT = 1e-9
"""Squared length of a direction, in units of that of the longest, below which it is rounding."""


def behaviours(weights: FloatArray, effects: FloatArray, seen: FloatArray) -> FloatArray:
    """(n, q (o + 1)) numbers whose distances are those of the module.

    Args:
        weights: (n, D) policies, or differences of policies.
        effects: (q, k) what a unit of weight of each action does.
        seen: (m, o + 1) recorded normalised observations, with their constant.
    """
    values, vectors = np.linalg.eigh(seen.T @ seen / len(seen))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.stack([(effects @ row.reshape(-1, len(root)) @ root).ravel() for row in weights])


def main_moves(policies: FloatArray, effects: FloatArray, seen: FloatArray, count: int) -> FloatArray:
    """(r, D) directions in which behaviour differs most, one unit of it long each; r is at most `count`.

    Directions in which the policies do not differ are left out.

    Args:
        policies: (n, D) initial ones.
        effects: (q, k) as in `behaviours`.
        seen: (m, o + 1) recorded normalised observations, with their constant.
        count: of directions.

    Raises:
        ProblemError: count is not between 1 and n - 1, or all policies are the same.
    """
    if not 1 <= count < len(policies):
        raise ProblemError(f"moves is {count}; expected 1 to {len(policies) - 1}")
    deviations = policies - policies.mean(axis=0)
    changes = behaviours(deviations, effects, seen)
    squares, combinations = leading(changes @ changes.T, count)
    kept = squares > _DEPENDENT * squares[0]
    if not kept.any():
        raise ProblemError("all initial policies do the same; expected ones that differ")
    return np.asarray((combinations[:, kept] / np.sqrt(squares[kept])).T @ deviations)


def move_features(moves: FloatArray, width: FloatArray) -> LinearFeatures:
    """How far policies lie along moves.

    Args:
        moves: (r, D) linearly independent ones.
        width: (D,) of the box.

    Returns:
        The map from (n, D) weights to (n, r) features. Of all steps in the unit cube of the box that change
        the features as asked, the shortest is along the moves.
    """
    steps = moves / width
    return LinearFeatures(np.linalg.solve(steps @ steps.T, steps) / width)
