"""Initial policies. Uniform weights are none: nearly all of them fail at once in the same way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdsafebo.errors import ProblemError
from hdsafebo.policies.affine import PolicySpace
from hdsafebo.typing import FloatArray

Design = Callable[[PolicySpace, int, np.random.Generator], FloatArray]
"""Draws (n, D) weights of initial policies."""


def gaussian_design(smallest: float = 0.05, largest: float = 1.0) -> Design:
    """Gaussian weights of all sizes: the deviation of actions, in units of action, is log-uniform.

    Args:
        smallest: deviation of actions at a typical observation.
        largest: the other limit.

    Raises:
        ProblemError: the limits are not ordered and positive.
    """
    if not 0 < smallest <= largest < np.inf:
        raise ProblemError(
            f"gaussian_design: sizes {smallest} to {largest}; expected positive numbers, the smaller first"
        )

    def draw(space: PolicySpace, n: int, rng: np.random.Generator) -> FloatArray:
        sizes = np.exp(rng.uniform(np.log(smallest), np.log(largest), (n, 1)))
        return sizes / np.sqrt(space.observations + 1) * rng.standard_normal((n, space.dimension))

    return draw
