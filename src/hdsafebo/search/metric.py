"""The metric of a searched space: how far apart points of the unit cube are in the inputs of the kernel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hdsafebo.errors import ProblemError
from hdsafebo.problem import Codec, LinearCodec, LinearFeatures, Problem, decoded, features_of
from hdsafebo.search.space import SearchSpace
from hdsafebo.typing import FloatArray, Shaped

_AFFINE_TOLERANCE = 1e-6
_BLOCK = 512  # unit vectors that features are probed with at once
_TINY = 1e-12  # least length that a step is divided by


@dataclass(frozen=True)
class Metric:
    """Affine map from the unit cube to kernel inputs, k = A u + b, where steps and radii are measured.

    Attributes:
        matrix: (p, d) A, or (d,) when it is diagonal.
        offset: (p,) b.
    """

    matrix: FloatArray
    offset: Shaped[FloatArray, " p"]

    @cached_property
    def hides_directions(self) -> bool:
        """Some steps change no kernel input, other than those along dimensions that do not vary at all."""
        if self.matrix.ndim == 1:
            return False
        varying = int(self.matrix.any(axis=0).sum())
        return len(self.matrix) < varying or int(np.linalg.matrix_rank(self.matrix)) < varying

    def inputs(self, u: Shaped[FloatArray, "n d"]) -> Shaped[FloatArray, "n p"]:
        """(n, p) kernel inputs of (n, d) points of the unit cube."""
        return self.offset + self.push_forward(u)

    def pull_back(self, gradient: Shaped[FloatArray, "n p"]) -> Shaped[FloatArray, "n d"]:
        """(n, d) gradients in the unit cube of (n, p) gradients in the kernel inputs."""
        return gradient * self.matrix if self.matrix.ndim == 1 else gradient @ self.matrix

    def push_forward(self, step: Shaped[FloatArray, "n d"]) -> Shaped[FloatArray, "n p"]:
        """(n, p) steps in kernel inputs of (n, d) steps in the unit cube."""
        return step * self.matrix if self.matrix.ndim == 1 else step @ self.matrix.T

    def inner(self, a: Shaped[FloatArray, "n d"], b: Shaped[FloatArray, "n d"]) -> Shaped[FloatArray, "n 1"]:
        """(n, 1) inner products, in kernel inputs, of (n, d) steps in the unit cube."""
        return np.einsum("ij,ij->i", self.push_forward(a), self.push_forward(b))[:, None]

    def length(self, step: Shaped[FloatArray, "n d"]) -> Shaped[FloatArray, "n 1"]:
        """(n, 1) lengths in kernel inputs of (n, d) steps in the unit cube."""
        return np.linalg.norm(self.push_forward(step), axis=1, keepdims=True)

    def normalised(self, step: Shaped[FloatArray, "n d"]) -> Shaped[FloatArray, "n d"]:
        """(n, d) steps of length one."""
        return step / np.maximum(self.length(step), _TINY)


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
        x = z if embedding is None else decoded(embedding, z)
        return features_of(problem, x)

    origin = features(np.zeros((1, d)))[0]
    stated = _stated_matrix(problem, embedding)
    if stated is not None:
        metric = Metric(stated * space.width, origin)
    else:
        blocks = [features(_unit_vectors(i, d)) - origin for i in range(0, d, _BLOCK)]
        metric = Metric(np.concatenate(blocks).T, origin)
    u = np.random.default_rng(0).random((4, d))
    error = np.abs(metric.inputs(u) - features(u)).max()
    size = np.abs(metric.matrix).max()
    if error > _AFFINE_TOLERANCE * max(size, 1e-300):
        raise ProblemError(
            f"features of {problem.name!r} differ by {error:.3g} from an affine function of the "
            f"codes with coefficients up to {size:.3g}; expected an affine map and a linear embedding"
        )
    return metric


def _stated_matrix(problem: Problem, embedding: Codec | None) -> FloatArray | None:
    """(p, d) matrix of the features of codes, where features and embedding state theirs; else None."""
    features = problem.features
    if not isinstance(features, LinearFeatures):
        return None
    if embedding is None:
        return features.matrix
    return embedding.compose(features.matrix) if isinstance(embedding, LinearCodec) else None


def _unit_vectors(first: int, d: int) -> FloatArray:
    """(k, d) rows of the identity from `first` on, at most a block of them: all would need d^2 numbers."""
    return np.eye(min(_BLOCK, d - first), d, first)
