"""What HeSBO and BAxUS share: latent points of their own random embedding, kept beside the trials."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hdsafebo.gp.ard_process import WarmStart
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.baselines.count_sketch import CountSketch
from hdsafebo.optimizers.settings import OptimizerSettings
from hdsafebo.search.candidates import sobol_points
from hdsafebo.trials import Status
from hdsafebo.typing import FloatArray

S = TypeVar("S", bound=OptimizerSettings)


class SubspaceOptimizer(Optimizer[S]):
    """Optimises over latent points y in [-1, 1]^d whose inputs are `sketch.lift(y)`.

    An embedding that is handed in is left aside, and the box is the problem's own: these methods bring
    their own embedding. A point given from outside has no latent point, so initial data cannot be used
    (`uses_initial_data`): the first round is the initial design, however many trials it has, drawn in the
    latent space. Outcomes are told of the latent point that was proposed, even where only candidates of a
    finite set can be evaluated. Safety is ignored.
    """

    uses_initial_data = False
    searches_codes = False
    uses = frozenset[str]()

    def prepare(self) -> None:
        """The first subspace; no latent points and no fits yet."""
        self._sketch = self.first_sketch()
        self._latent = np.empty((0, self._sketch.dimension))
        self._warm = WarmStart()

    def first_sketch(self) -> CountSketch:
        """The embedding to begin with."""
        raise NotImplementedError

    def propose_latent(self, y: FloatArray, objective: FloatArray, n: int) -> tuple[FloatArray, float]:
        """n latent points and the length of their region, from (k, d) latent points in the unit cube."""
        raise NotImplementedError

    def propose(self, n: int) -> Proposal:
        """n lifted latent points; a Sobol design as long as nothing is known."""
        rows, y = self._known()
        if len(rows) == 0:
            latent, length = sobol_points(n, self._sketch.dimension, self.rng), np.nan
        else:
            latent, length = self.propose_latent(y, self.trials.objective[rows], n)
        missing = np.full((len(self.trials) - len(self._latent), self._sketch.dimension), np.nan)
        self._latent = np.vstack([self._latent[: len(self.trials)], missing, 2.0 * latent - 1.0])
        lifted = self._sketch.lift(self._latent[-len(latent) :])
        return Proposal((lifted + 1.0) / 2.0, trust_region_length=length)

    def waiting(self) -> FloatArray:
        """(k, d) latent points in the unit cube whose results are still out."""
        latent = self._latent[: len(self.trials)][self.trials.status[: len(self._latent)] == Status.PENDING]
        return (latent[np.isfinite(latent[:, 0])] + 1.0) / 2.0

    def _known(self) -> tuple[NDArray[np.int64], FloatArray]:
        """Rows of the completed trials that have a latent point, and those points in the unit cube."""
        own = len(self._latent)
        rows = np.flatnonzero(self.trials.completed[:own] & np.isfinite(self._latent[:, 0]))
        return rows, (self._latent[rows] + 1.0) / 2.0

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Embedding, latent points and last fits."""
        arrays = {"bins": self._sketch.bins, "signs": self._sketch.signs, "latent": self._latent}
        return {"dimension": self._sketch.dimension}, arrays | self._warm.arrays()

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `method_state` gave."""
        self._sketch = CountSketch(arrays["bins"], arrays["signs"], state["dimension"])
        self._latent = arrays["latent"]
        self._warm = WarmStart.of(arrays)
