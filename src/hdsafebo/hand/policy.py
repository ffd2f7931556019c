"""Linear feedback policies: muscle excitations from observations, over synergies or over single muscles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdsafebo.errors import HandModelError
from hdsafebo.typing import FloatArray


@dataclass(frozen=True)
class LinearPolicySpace:
    """The linear policies a = clip(base + basis' W o, 0, 1) (paper, section 5.2), W being what is optimised.

    With the identity as basis, W has one row per muscle: the original space, 3575 weights for 55 muscles
    and 65 observations. With 5 synergies as basis it has 5 rows, 325 weights. Both spaces share `base`, so
    the policy W over synergies is the policy basis' W over muscles.

    Attributes:
        base: (muscles,) excitations of the zero policy.
        basis: (rows, muscles) one synergy per row.
        observations: length of an observation.
    """

    base: FloatArray
    basis: FloatArray
    observations: int

    def __post_init__(self) -> None:
        if self.base.ndim != 1 or self.basis.ndim != 2 or self.basis.shape[1] != len(self.base):
            raise HandModelError(
                f"base {self.base.shape} and basis {self.basis.shape} do not fit; "
                "expected (muscles,) and (rows, muscles)"
            )
        if not (np.isfinite(self.base).all() and np.isfinite(self.basis).all()):
            raise HandModelError("base or basis of the policies is not finite")

    @classmethod
    def original(cls, base: FloatArray, observations: int) -> LinearPolicySpace:
        """One row of weights per muscle."""
        return cls(base, np.eye(len(base)), observations)

    @property
    def dimension(self) -> int:
        """Number of weights of a policy."""
        return len(self.basis) * self.observations

    def weights(self, parameters: FloatArray) -> FloatArray:
        """The weight matrices of n parameter vectors.

        Args:
            parameters: (n, dimension).

        Returns:
            (n, rows, observations).

        Raises:
            HandModelError: wrong shape, or not finite.
        """
        values = np.asarray(parameters, float)
        if values.ndim != 2 or values.shape[1] != self.dimension:
            raise HandModelError(
                f"policies have shape {values.shape}; expected (n, {self.dimension}): "
                f"{len(self.basis)} x {self.observations} weights each"
            )
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            raise HandModelError(
                f"policies {np.flatnonzero(~finite).tolist()[:10]} have weights that are not finite"
            )
        return values.reshape(-1, len(self.basis), self.observations)

    def to_original(self, parameters: FloatArray) -> FloatArray:
        """(n, muscles * observations) the same policies with one row of weights per muscle."""
        return np.einsum("km,nko->nmo", self.basis, self.weights(parameters)).reshape(len(parameters), -1)

    def excitation(self, weights: FloatArray, observation: FloatArray) -> FloatArray:
        """(muscles,) excitations in [0, 1] of one (rows, observations) weight matrix."""
        return np.clip(self.base + (weights @ observation) @ self.basis, 0.0, 1.0)
