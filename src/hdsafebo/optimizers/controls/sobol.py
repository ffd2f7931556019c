"""Control without a model: a space-filling sequence over the whole box."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.settings import OptimizerSettings
from hdsafebo.typing import FloatArray

_SEEDS = 2**32
_MOST_DIMENSIONS = qmc.Sobol.MAXDIM


class Sobol(Optimizer[OptimizerSettings]):
    """Successive points of one scrambled Sobol sequence; on a finite candidate set, rows drawn uniformly.

    Sobol numbers are known for 21,201 dimensions. With more, points are drawn uniformly; in so many
    dimensions no sequence of a few thousand points fills anything.

    Snapping points of the box to their nearest candidates would favour candidates with large surroundings,
    so rows are drawn directly. Every table of results has this method: what does not beat it has learnt
    nothing.
    """

    name = "sobol"
    uses = frozenset({"latent_space", "candidate_rows"})

    def prepare(self) -> None:
        """Draw the seed of the sequence."""
        self._sequence = int(self.rng.integers(_SEEDS))

    def propose(self, n: int) -> Proposal:
        """The next n points of the sequence, or n rows that were not proposed yet."""
        if self.problem.candidates is not None:
            free = np.setdiff1d(np.arange(len(self.problem.candidates)), self.taken, assume_unique=True)
            return Proposal(rows=self.rng.choice(free, n, replace=False))
        drawn = int((self.trials.round > 0).sum())
        return Proposal(points=sobol_points(drawn + n, self.space.dimension, self._sequence)[drawn:])

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Seed of the sequence; how far it was drawn follows from the trials."""
        return {"sequence": self._sequence}, {}

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `method_state` gave."""
        self._sequence = state["sequence"]


def sobol_points(n: int, dimension: int, seed: int) -> FloatArray:
    """The first n points of the scrambled Sobol sequence of a seed, in the unit cube; see `Sobol`."""
    if dimension > _MOST_DIMENSIONS:
        return np.random.default_rng(seed).random((n, dimension))
    whole = qmc.Sobol(dimension, rng=seed).random_base2(int(np.ceil(np.log2(n))))
    return np.asarray(whole[:n])
