"""What every search of the local method provides, and the optimiser that follows one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import asdict
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hdsafebo.gp.fit import NoisePrior
from hdsafebo.gp.surrogate import Beliefs, DistanceCache, Surrogate
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.core.fits import State
from hdsafebo.optimizers.settings import SafeSetSettings
from hdsafebo.problem import features_of
from hdsafebo.search.region import IMPROVEMENT, TrustRegion, TrustRegionRule, safe_update
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray, IntArray


class LocalSearch(ABC):
    """One way to search around the best safe trials, on behalf of an optimiser.

    Args:
        optimizer: whose trials, surrogate, settings and generator are used.

    Attributes:
        noise_prior: what is known beforehand of the noise of all functions.
    """

    noise_prior: NoisePrior = NoisePrior()

    def __init__(self, optimizer: SearchingOptimizer) -> None:
        self.optimizer = optimizer

    @abstractmethod
    def propose(self, n: int) -> Proposal:
        """Choose up to n points; see `Optimizer.propose`."""

    def finish_round(self, trials: Trials) -> None:  # noqa: B027 (a search may have nothing to learn)
        """Learn from a round whose results are all known now; see `Optimizer.finish_round`."""

    def kernel_inputs(self, trials: Trials) -> FloatArray:
        """(n, p) what the kernel measures distances between, for the points of `trials`."""
        optimizer = self.optimizer
        if optimizer.problem.features is None:
            return optimizer.space.kernel_inputs(optimizer.space.to_unit(trials.z))
        return features_of(optimizer.problem, trials.x)

    def fit(self, rows: IntArray, start: State | None, cache: DistanceCache) -> Beliefs:
        """What is believed given the completed trials `rows`; see `Optimizer.fit`."""
        return Optimizer.fit(self.optimizer, rows, start, cache)

    def targets(self, rows: IntArray) -> FloatArray:
        """(k,) what the objective's process is fitted to, of the completed trials `rows`."""
        return self.trials.objective[rows]

    def refines(self) -> bool:
        """Whether a fit searches hyper-parameters, or keeps those of the fit before."""
        return True

    def centre_row(self) -> int | None:
        """Row of the trial to search around; None takes Algorithm 1's x*."""
        return None

    def state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """What is remembered beyond trials, generator and fits: plain data, and arrays by name."""
        return {}, {}

    def restore(  # noqa: B027 (a search may have nothing to remember)
        self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]
    ) -> None:
        """Take back what `state` gave."""

    # --- what searches share

    @property
    def trials(self) -> Trials:
        """All trials of the optimiser."""
        return self.optimizer.trials

    @property
    def surrogate(self) -> Surrogate:
        """What is believed: isotropic processes."""
        surrogate = self.optimizer.surrogate
        assert isinstance(surrogate, Surrogate)
        return surrogate

    @property
    def rng(self) -> np.random.Generator:
        """The optimiser's generator."""
        return self.optimizer.rng

    @property
    def confidence(self) -> float:
        """The beta of the safe set."""
        return self.optimizer.promised_beta

    def best_first(self, which: NDArray[np.bool_]) -> IntArray:
        """Rows where `which` is True, the highest objective first."""
        rows = np.flatnonzero(which)
        return rows[np.argsort(-self.trials.objective[rows], kind="stable")]


class RegionSearch(LocalSearch):
    """A search in a trust region around the best safe trial.

    Attributes:
        rule: constants of the trust region.
        since: id of the first trial that counts for the centre and for gains.
        region: the trust region.
    """

    rule: TrustRegionRule

    def __init__(self, optimizer: SearchingOptimizer) -> None:
        super().__init__(optimizer)
        self.since = 0
        self.region = TrustRegion(self.rule.initial)

    def finish_round(self, trials: Trials) -> None:
        """A round succeeds when it improves on the best feasible objective."""
        improved, _ = gain(self.trials, self.own, trials.id)
        self.region = safe_update(self.region, improved, self.rule)

    @property
    def own(self) -> NDArray[np.bool_]:
        """(n,) True for feasible trials that count."""
        return self.optimizer.feasible & (self.trials.id >= self.since)

    def centre_row(self) -> int | None:
        """Row of the best feasible trial among those that count and are believed safe; None without one.

        Around a trial that was safe by luck or by less than the noise, little is believed safe. After a
        restart the best feasible trial will do. Under contexts the optimiser's own choice counts.
        """
        if self.optimizer.problem.contexts:
            return None
        rows = self.best_first(self.own)[:CENTRES]
        if len(rows) == 0:
            return None
        inputs = self.optimizer.inputs_of(rows)
        believed = rows[self.surrogate.believed_safe(inputs, self.confidence)]
        if len(believed) == 0 and self.since == 0:
            return None
        return int(believed[0] if len(believed) else rows[0])

    def state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """The region, and since when trials count."""
        return {"since": self.since} | asdict(self.region), {}

    def restore(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `state` gave."""
        self.since = state["since"]
        self.region = TrustRegion(state["length"], state["successes"], state["failures"])


CENTRES = 100
"""So many of the best trials may be the centre."""


S = TypeVar("S", bound=SafeSetSettings)


class SearchingOptimizer(Optimizer[S]):
    """An optimiser that leaves choosing, and what the model sees, to a search."""

    _search: LocalSearch | None = None
    _features: FloatArray | None = None

    @abstractmethod
    def make_search(self) -> LocalSearch:
        """The search of this problem; it may look at the searched space."""

    @property
    def search(self) -> LocalSearch:
        """The search, made when it is first needed: an embedding's box follows from the first trials."""
        if self._search is None:
            self._search = self.make_search()
        return self._search

    def propose(self, n: int) -> Proposal:
        """What the search proposes."""
        return self.search.propose(n)

    def finish_round(self, trials: Trials) -> None:
        """The search learns."""
        self.search.finish_round(trials)

    def centre_row(self) -> int:
        """Row of the search's centre; without one, that of Algorithm 1's x*."""
        row = self.search.centre_row()
        return super().centre_row() if row is None else row

    @property
    def confidence(self) -> float:
        """The beta of the safe set: the given one, lowered where it promised too much."""
        return self.search.confidence

    def kernel_inputs(self, trials: Trials) -> FloatArray:
        """What the search's kernel measures distances between."""
        return self.search.kernel_inputs(trials)

    def inputs_of(self, rows: IntArray) -> FloatArray:
        """Kernel inputs; features of an input are computed once and kept.

        They are computed trial by trial: in another batch, a product of matrices may have other bits.
        """
        if self.problem.features is None or self.problem.candidates is not None:
            return super().inputs_of(rows)
        known = 0 if self._features is None else len(self._features)
        if known < len(self.trials):
            fresh = [self.kernel_inputs(self.trials[[i]]) for i in range(known, len(self.trials))]
            before = [] if self._features is None else [self._features]
            self._features = np.concatenate([*before, *fresh])
        assert self._features is not None
        return self._features[rows]

    def fit(self, rows: IntArray, start: State | None, cache: DistanceCache) -> Beliefs:
        """As the search does."""
        return self.search.fit(rows, start, cache)

    @property
    def noise_prior(self) -> NoisePrior:
        """That of the search."""
        return self.search.noise_prior

    def outcomes_to_fit(self, rows: IntArray) -> FloatArray:
        """The search's targets."""
        return self.search.targets(rows)

    def refines(self) -> bool:
        """As the search says."""
        return self.search.refines()

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """That of the search; nothing while there is none."""
        return ({}, {}) if self._search is None else self._search.state()

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `method_state` gave."""
        self._features = None  # the trials may be others
        if state:
            self.search.restore(state, arrays)
        else:
            self._search = None


def gain(trials: Trials, among: NDArray[np.bool_], fresh: IntArray) -> tuple[bool, bool]:
    """Whether trials improve on the best of the others, and by more than a thousandth of its size.

    Args:
        trials: all of them.
        among: (n,) True for those that count.
        fresh: ids of the trials in question.
    """
    new = np.isin(trials.id, fresh)
    best = trials.objective[among & new].max(initial=-np.inf)
    before = trials.objective[among & ~new].max(initial=-np.inf)
    if not np.isfinite(best):
        return False, False
    if not np.isfinite(before):
        return True, True
    return bool(best > before), bool(best > before + IMPROVEMENT * abs(before))
