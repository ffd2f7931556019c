"""Kernel inputs of policies: what they do at recorded observations.

Distances between weights say little of behaviour, which few of them decide. Two policies differ by the mean
squared difference of their actions over observations that policies meet; seen along the main directions of
observations and of actions, that is a distance of a few dozen numbers, linear in the weights.
"""

from __future__ import annotations

import numpy as np

from hdsafebo.errors import ProblemError
from hdsafebo.problem import LinearFeatures
from hdsafebo.typing import FloatArray

_BLOCK = 256


def behaviour_features(
    seen: FloatArray, directions: int, action_axes: FloatArray, actions: int
) -> LinearFeatures:
    """Features of affine policies: their actions along `action_axes`, at the main directions of `seen`.

    Args:
        seen: (n, o + 1) recorded normalised observations, with their constant.
        directions: main directions of observations that are kept.
        action_axes: (k, q) orthonormal directions of actions.
        actions: k.

    Returns:
        The map from (n, k (o + 1)) weights to (n, q * directions) features, in units of action.

    Raises:
        ProblemError: more directions than observations, or axes of other actions.
    """
    if not 1 <= directions <= seen.shape[1]:
        raise ProblemError(f"directions is {directions}; expected 1 to {seen.shape[1]}")
    if action_axes.ndim != 2 or len(action_axes) != actions:
        raise ProblemError(f"action axes have shape {action_axes.shape}; expected ({actions}, q)")
    values, vectors = leading(seen.T @ seen / len(seen), directions)
    scaled = vectors * np.sqrt(values)
    matrix = np.einsum("kq,or->qrko", action_axes, scaled)
    return LinearFeatures(matrix.reshape(action_axes.shape[1] * directions, -1))


def leading(moment: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """The largest (count,) eigenvalues of a second moment, and their (n, count) directions.

    Each direction has the sign that makes its entry of largest size positive.
    """
    values, vectors = np.linalg.eigh(moment)
    kept = np.argsort(values)[::-1][:count]
    chosen = vectors[:, kept]
    signs = np.sign(chosen[np.abs(chosen).argmax(axis=0), np.arange(len(kept))])
    return np.maximum(values[kept], 0.0), chosen * signs


def main_actions(seen: FloatArray, policies: FloatArray, count: int) -> FloatArray:
    """(k, count) main directions in which actions of the given policies differ over recorded observations.

    Args:
        seen: (n, o + 1) recorded normalised observations, with their constant.
        policies: (m, k, o + 1) weights.
        count: of directions, at most k.
    """
    k = policies.shape[1]
    total, moment, n = np.zeros(k), np.zeros((k, k)), 0
    for weights in policies:
        for rows in np.array_split(seen, max(1, len(seen) // _BLOCK)):
            actions = rows @ weights.T
            total += actions.sum(axis=0)
            moment += actions.T @ actions
            n += len(rows)
    mean = total / n
    return leading(moment / n - np.outer(mean, mean), count)[1]
