"""Kernel inputs of policies: what they do at recorded observations.

Distances between weights say little of behaviour, which few of them decide. Two policies differ by the mean
squared difference of their actions over observations that policies meet; seen along the main directions of
observations, that is a distance of a few dozen numbers, linear in the weights.
"""

from __future__ import annotations

import numpy as np

from hdsafebo.errors import ProblemError
from hdsafebo.problem import LinearFeatures
from hdsafebo.typing import FloatArray


def behaviour_features(seen: FloatArray, directions: int, actions: int) -> LinearFeatures:
    """Features of affine policies: their actions at the main directions of `seen`.

    Args:
        seen: (n, o + 1) recorded normalised observations, with their constant.
        directions: main directions of observations that are kept.
        actions: k.

    Returns:
        The map from (n, k (o + 1)) weights to (n, k * directions) features, in units of action.

    Raises:
        ProblemError: more directions than observations.
    """
    if not 1 <= directions <= seen.shape[1]:
        raise ProblemError(f"directions is {directions}; expected 1 to {seen.shape[1]}")
    values, vectors = leading(seen.T @ seen / len(seen), directions)
    scaled = vectors * np.sqrt(values)
    return LinearFeatures(np.kron(np.eye(actions), scaled.T).astype(np.float64))


def leading(moment: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """The largest (count,) eigenvalues of a second moment, and their (n, count) directions.

    Each direction has the sign that makes its entry of largest size positive.
    """
    values, vectors = np.linalg.eigh(moment)
    kept = np.argsort(values)[::-1][:count]
    chosen = vectors[:, kept]
    signs = np.sign(chosen[np.abs(chosen).argmax(axis=0), np.arange(len(kept))])
    return np.maximum(values[kept], 0.0), chosen * signs
