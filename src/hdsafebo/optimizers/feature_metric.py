"""The metric of a searched space: how far apart points of the unit cube are in the inputs of the kernel."""

from __future__ import annotations

import numpy as np

from hdsafebo.ascent import Metric
from hdsafebo.errors import ProblemError
from hdsafebo.optimizers.proposal import Codec
from hdsafebo.problem import FloatArray, Problem
from hdsafebo.search_space import SearchSpace

_AFFINE_TOLERANCE = 1e-6


def kernel_metric(problem: Problem, embedding: Codec | None, space: SearchSpace) -> Metric:
    """From the unit cube to kernel inputs: the code's own metric, or the features of what it decodes to.

    Args:
        problem: its `features`, when it has some, are what the kernel measures distances between.
        embedding: map between inputs and codes; None when the inputs themselves are searched.
        space: box that is searched.

    Raises:
        ProblemError: features of decoded codes are no affine function of the codes.
    """
    d = space.dimension
    if problem.features is None:
        return Metric(np.where(space.width > 0, space.metric, 0.0), np.zeros(d))

    def features(u: FloatArray) -> FloatArray:
        z = space.to_code(u)
        x = z if embedding is None else np.asarray(embedding.decode(z), float)
        assert problem.features is not None
        return np.asarray(problem.features(x), float)

    corners = features(np.concatenate([np.zeros((1, d)), np.eye(d)]))
    metric = Metric((corners[1:] - corners[0]).T, corners[0])
    u = np.random.default_rng(0).random((4, d))
    error = np.abs(metric.inputs(u) - features(u)).max()
    size = np.abs(metric.matrix).max()
    if error > _AFFINE_TOLERANCE * max(size, 1e-300):
        raise ProblemError(
            f"features of {problem.name!r} differ by {error:.3g} from an affine function of the "
            f"codes with coefficients up to {size:.3g}; expected an affine map and a linear embedding"
        )
    return metric
