"""HdSafeBO in a neighbourhood whose size the fitted model decides; see the package for its searches."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import ParamsError
from hdsafebo.gp.surrogate import Beliefs, DistanceCache, SurrogateState
from hdsafebo.gp.warped_surrogate import WarpedState
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.core.fits import State
from hdsafebo.optimizers.local.ascents import AscentSearch
from hdsafebo.optimizers.local.base import LocalSearch, SearchingOptimizer
from hdsafebo.optimizers.local.constrained.chart import OwnInputs, VisibleSteps
from hdsafebo.optimizers.local.constrained.search import ConstrainedSearch
from hdsafebo.optimizers.local.hidden import HiddenSearch
from hdsafebo.optimizers.local.pools import PoolSearch
from hdsafebo.optimizers.local.restarts import Restarts
from hdsafebo.optimizers.local.rows import RowSearch
from hdsafebo.optimizers.local.settings import HdSafeBOLocalSettings, RestartSettings
from hdsafebo.search.row_space import RowSpace
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import IntArray

_MOST_INPUTS = 100
"""Beyond, steps of SLSQP, whose work grows with the cube of their number, take most of a round."""
_HIDDEN = 0.2
"""Of the length of the steps between initial trials, what features may hide: rounding and small change."""


class HdSafeBOLocal(SearchingOptimizer[HdSafeBOLocalSettings]):
    """Local variant of HdSafeBO.

    Raises:
        ParamsError: settings are given for a part that this problem does not use, besides what `Optimizer`
            raises.
    """

    name = "hdsafebo_local"
    holds_contexts = True
    Settings = HdSafeBOLocalSettings
    uses = Optimizer.uses | {"candidate_rows"}

    def prepare(self) -> None:
        """Refuse settings of a part that the problem does not use."""
        if self.settings.restarts is not None and (not self._continuous or self._searches_inputs()):
            raise ParamsError(
                f"method {self.name!r}: setting 'restarts' is of continuous spaces that are searched through "
                f"an embedding or features; {self.problem.name!r} is searched without, or has a finite "
                "candidate set, points that cannot be run, or contexts"
            )
        self._restarts: Restarts | None = None
        self._seen: tuple[bytes, bool] | None = None

    def make_search(self) -> LocalSearch:
        """The one that suits the problem and the searched space."""
        if self.problem.candidates is not None:
            return RowSearch(self)
        metric, self._restarts = self.metric, None
        if not self._continuous:
            return PoolSearch(self, metric)
        if self._constrained():
            own = self._searches_inputs()
            return ConstrainedSearch(self, OwnInputs(self) if own else VisibleSteps(metric, self))
        search = HiddenSearch(self, metric) if metric.hides_directions else AscentSearch(self, metric)
        self._restarts = Restarts(search, self.settings.restarts or RestartSettings())
        return search

    @property
    def search(self) -> LocalSearch:
        """The search; the constrained one ends with the first failure that teaches."""
        if self._search is not None and isinstance(self._search, ConstrainedSearch) != self._constrained():
            self._search, self._features = None, None
        return super().search

    def fit(self, rows: IntArray, start: State | None, cache: DistanceCache) -> Beliefs:
        """As the search does; a search that took over has no earlier fit."""
        kind = WarpedState if isinstance(self.search, ConstrainedSearch) else SurrogateState
        return super().fit(rows, start if isinstance(start, kind) else None, cache)

    @property
    def _continuous(self) -> bool:
        """Whether every point of the searched box can be run, and all of its columns are chosen."""
        problem = self.problem
        return problem.candidates is None and not problem.lands and not problem.contexts

    def _constrained(self) -> bool:
        """Whether the constrained search can do it: its models have no place for a failure."""
        failed = self.problem.failures_teach and bool((self.trials.status == Status.FAILED).any())
        return self._continuous and not failed and (self._searches_inputs() or self._hides_nothing())

    def _searches_inputs(self) -> bool:
        """Whether a length scale per input makes sense: inputs are the problem's own, and not too many."""
        own = self.embedding is None and self.problem.features is None
        return own and self.space.dimension <= _MOST_INPUTS

    def _hides_nothing(self) -> bool:
        """Whether initial trials differ in what kernel inputs see alone, where that is few numbers.

        Then nothing is known of the directions that features hide, and steps along them are noise.
        """
        matrix = self.metric.matrix
        if self.problem.features is None or matrix.ndim == 1 or len(matrix) > _MOST_INPUTS:
            return False
        if not self.metric.hides_directions:
            return False
        initial = np.flatnonzero(self.trials.initial)
        if len(initial) == 0:
            return False
        key = len(initial).to_bytes(8) + self.trials.z[initial[-1]].tobytes()  # asked for many times a round
        if self._seen is None or self._seen[0] != key:
            known = self.space.to_unit(self.trials.z[initial])
            steps, rows = known - known.mean(axis=0), RowSpace.of(self.metric)
            hidden = np.linalg.norm(steps - steps @ rows.basis.T @ rows.basis)
            self._seen = key, rows.rank == len(matrix) and bool(hidden < _HIDDEN * np.linalg.norm(steps))
        return self._seen[1]

    def propose(self, n: int) -> Proposal:
        """What the search proposes; a single trial may begin the next climb instead."""
        search = self.search
        if n == 1 and self._restarts is not None and (first := self._restarts.first_of_next()) is not None:
            return first
        return search.propose(n)

    def finish_round(self, trials: Trials) -> None:
        """The search and its restarts learn."""
        if self._restarts is not None:
            self._restarts.finish_round(trials)
        super().finish_round(trials)

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Of the search, and of its restarts."""
        if self._search is not None:
            _ = self.search  # the one that a loaded optimiser would have
        state, arrays = super().method_state()
        return state | ({} if self._restarts is None else self._restarts.state()), arrays

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `method_state` gave."""
        super().restore_method_state(state, arrays)
        if self._search is None:
            self._restarts = None
        elif self._restarts is not None:
            self._restarts.restore(state)
