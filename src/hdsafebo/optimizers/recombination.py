"""What evolution strategies know of searching many dimensions, for steps that a model only partly predicts.

Around one best point, chance decides: where outcomes are rugged it is a spike, often at the edge of the safe
set. The weighted mean of several good points lies where good points are common (intermediate recombination:
Hansen, The CMA evolution strategy: a tutorial, arXiv:1604.00772, section 3.2).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hdsafebo.problem import FloatArray


def recombined(parents: FloatArray) -> FloatArray:
    """(d,) mean of the (k, d) parents, the best first, with CMA-ES's logarithmic weights."""
    k = len(parents)
    weights = np.log(k + 0.5) - np.log(np.arange(1, k + 1))
    return np.asarray(weights @ parents / weights.sum())


def normal_steps(
    centre: FloatArray, sizes: tuple[float, float], n: int, rng: np.random.Generator
) -> FloatArray:
    """(n, d) points of the unit cube at normal steps from the (d,) centre, the smallest first.

    Args:
        centre: of the unit cube.
        sizes: smallest and largest standard deviation per dimension; those between grow geometrically.
        n: number of steps.
        rng: source of randomness.
    """
    deviation = np.geomspace(*sizes, n)[:, None]
    return np.clip(centre + deviation * rng.standard_normal((n, len(centre))), 0.0, 1.0)


def size_classes(steps: FloatArray, inputs: FloatArray, n: int) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Up to n parts of steps and their kernel inputs, in the order of their sizes, none of them empty."""
    for part in np.array_split(np.arange(len(steps)), n):
        if len(part):
            yield steps[part], inputs[part]
