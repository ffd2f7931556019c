"""Control without a model: the weakest stimulation, at random."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from hdsafebo.errors import ProblemError, TrialError
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.settings import OptimizerSettings
from hdsafebo.typing import IntArray


@runtime_checkable
class HasWeakest(Protocol):
    """A candidate set that knows which of its rows act least."""

    def weakest(self) -> IntArray:
        """Rows at the lowest level of action, such as the lowest current."""


class RandomLowest(Optimizer[OptimizerSettings]):
    """Rows drawn uniformly among those at the lowest current.

    If this control comes near a method, the task is trivial: nearly every row is safe at the lowest
    current, so an optimum that lies there is found without any thought of safety.

    Raises:
        ProblemError: the problem has no candidate set that offers `weakest()`.
    """

    name = "random_lowest"
    uses = frozenset({"candidate_rows"})

    def prepare(self) -> None:
        """Find the weakest rows."""
        candidates = self.problem.candidates
        if not isinstance(candidates, HasWeakest):
            raise ProblemError(
                f"random_lowest needs a candidate set with a method weakest(); problem {self.problem.name!r} "
                f"has {'none' if candidates is None else type(candidates).__name__}"
            )
        self._weakest: IntArray = np.asarray(candidates.weakest())

    def propose(self, n: int) -> Proposal:
        """Up to n rows at the lowest level that were not proposed yet."""
        free = np.setdiff1d(self._weakest, self.taken)
        if len(free) == 0:
            raise TrialError(
                f"all {len(self._weakest)} candidates of {self.problem.name!r} at the lowest level are taken"
            )
        return Proposal(rows=self.rng.choice(free, min(n, len(free)), replace=False))
