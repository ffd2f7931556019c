"""Search of inputs, or of what kernel inputs see: constrained ascents in a safe set that heeds its errors.

A round, in five steps:

1. Every function has a process of its own, with a length scale per input and a warp (`gp.warped_surrogate`).
2. The safe set (`SafeMargins`): every safety function's bound keeps a share of the margin that the incumbent
   has, as interior-point methods do, so that one step never uses up all of it; and no deviation is larger
   than a share of the prior's, since where nothing is known a bound is a guess. Deviations are inflated by
   the model's own last errors (`Expectations`).
3. The first trial climbs the posterior mean; the others mean + kappa * deviation, kappa growing and then
   random.
4. After each, the objective is told its own mean there, so that the next looks elsewhere. The safety
   functions are told nothing: that would walk out of the safe set on imagined evidence.
5. All this happens in a box around the incumbent that doubles after a round without a violation and halves
   after one with it. While nothing is gained, all trials but the first look in the whole cube.

The very first round only probes, at distances over orders of magnitude: what is near the incumbent tells the
length scales.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from hdsafebo.gp.surrogate import Beliefs, DistanceCache, modelled_safety, modelled_thresholds
from hdsafebo.gp.warped_surrogate import SAFETY, WarpedState, WarpedSurrogate, fit_warped_surrogate
from hdsafebo.optimizers.base import Proposal
from hdsafebo.optimizers.core.empty_set import complete_batch
from hdsafebo.optimizers.core.fits import State, known_noise
from hdsafebo.optimizers.local.base import RegionSearch, SearchingOptimizer
from hdsafebo.optimizers.local.constrained.ascent import SafeMargins
from hdsafebo.optimizers.local.constrained.batch import Batch, candidates_around
from hdsafebo.optimizers.local.constrained.chart import Chart
from hdsafebo.optimizers.local.constrained.expectations import Expectations
from hdsafebo.search.region import TrustRegionRule, safe_update
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import FloatArray, IntArray

_BATCH = 5
"""Trials that single ones are counted as a round of, for probes, kappas and stalls."""
_KAPPAS = (0.0, 1.0, 2.0)
"""Deviations that the first trials of a round add to the mean; the others add up to the last."""
_KEPT = 0.3
"""Share of the incumbent's margin that is kept."""
_CAP = 0.5
"""Largest deviation of a safety function, in prior deviations: where all that is known lies in one place,
length scales may be far too long. At 0.15 it was this that held steps back on the body, whose margins are
wide."""
_PROBES = (1e-3, 2e-2)
"""Distances of the first round, in median distances of the initial data."""
_CENTRES = 8
"""Best trials that candidates lie around."""
_STALLED_ROUNDS = 2
"""Without gain, after which trials look everywhere."""
_GAIN = 3e-3
"""Of the safe objectives' deviation; less is no gain."""
_FAR = 2.0
"""Factor of kappa while nothing is gained."""


class ConstrainedSearch(RegionSearch):
    """See the module.

    Args:
        optimizer: see `RegionSearch`.
        chart: the coordinates that are searched.

    Attributes:
        expectations: what was expected of asked trials, and the last errors.
    """

    # Half sides of the box, in sides of the cube.
    rule = TrustRegionRule(initial=0.1, least=0.005, most=1.0, successes=1, failures=1, restart=False)

    def __init__(self, optimizer: SearchingOptimizer, chart: Chart) -> None:
        super().__init__(optimizer)
        self.chart = chart
        self.expectations = Expectations(sum(s.modelled for s in optimizer.problem.safety))
        self._best = -np.inf
        self._stalled = 0

    # --- what the model sees

    @property
    def model(self) -> WarpedSurrogate:
        """What is believed."""
        surrogate = self.optimizer.surrogate
        assert isinstance(surrogate, WarpedSurrogate)
        return surrogate

    def kernel_inputs(self, trials: Trials) -> FloatArray:
        """(n, r) coordinates of the chart."""
        return self.chart.coordinates(trials)

    def fit(self, rows: IntArray, start: State | None, cache: DistanceCache) -> Beliefs:
        """Warped processes; the objective's warp is centred at the best feasible value."""
        assert start is None or isinstance(start, WarpedState)
        trials, functions = self.trials[rows], self.optimizer.problem.safety
        feasible = self.optimizer.feasible[rows]
        values = trials.objective[feasible] if feasible.any() else trials.objective
        surrogate = fit_warped_surrogate(
            self.optimizer.inputs_of(rows),
            trials.objective,
            modelled_safety(functions, trials.safety),
            modelled_thresholds(functions),
            best=float(values.max()),
            start=start,
            noise=known_noise(self.optimizer.problem, trials.noise, True),
            least_noise=self.chart.least_noise,
        )
        return replace(surrogate, inflation=self.expectations.inflation(surrogate.safety))

    def centre_row(self) -> int | None:
        """Row of the incumbent: of the feasible trials that keep their margins the highest by posterior mean.

        Noise moves a posterior mean less than an outcome. A trial whose bounds, with its own deviations, do
        not keep the share of its margins that the safe set demands was safe by luck, or by less than the
        noise; it is the incumbent only where there is no other. None without a feasible trial.
        """
        model, rows = self.model, self.optimizer.rows_to_fit()
        own = self.own[rows]
        if not own.any():
            return None
        margins = np.array([p.smoothed for p in model.safety]) - model.standard_thresholds[:, None]
        deviations = np.array([p.smoothed_deviation for p in model.safety])
        beta = min(self.confidence, 0.0)
        kept = _KEPT * (margins + model.taken_by_noise(beta)[:, None])
        bounds = margins + model.counted(beta)[:, None] * deviations
        believed = own & (bounds >= kept).all(axis=0)
        which = believed if believed.any() else own
        return int(rows[which][model.objective.smoothed[which].argmax()])

    # --- a round

    def propose(self, n: int) -> Proposal:
        """Probes first, then constrained ascents."""
        asked = int((self.trials.round > 0).sum())
        batch = self._begin(n)
        if asked < _BATCH:
            for distance in self._probes(n)[asked : asked + n]:
                batch.probe(distance)
        for i in range(len(batch.chosen), n):
            batch.climb(*self._plan((asked + i) % max(n, _BATCH), n))
        return self._finish(batch, n)

    def _begin(self, n: int) -> Batch:
        """What the trials of a round share."""
        row = self.optimizer.centre_row()
        model, trials = self.model, self.trials
        rows = self.optimizer.rows_to_fit()
        at = np.flatnonzero(rows == row)
        chart = self.chart
        inputs = np.clip(self.optimizer.inputs_of(np.arange(len(trials))), chart.low, chart.high)
        open_trials = (trials.status == Status.PENDING) | (trials.status == Status.FAILED)
        good = self.best_first(self.own)[:_CENTRES]
        box = chart.high - chart.low if self._stuck(n) else self.region.length
        return Batch(
            inputs[row],
            self._margins(int(at[0])),
            model.posteriors.believing(inputs[open_trials]),
            candidates_around(
                inputs[row],
                inputs[good if len(good) else [row]],
                self.region.length,
                box,
                (chart.low, chart.high),
                self.rng,
            ),
            self.rng,
            (chart.low, chart.high),
        )

    def _margins(self, at: int) -> SafeMargins:
        """The safe set, given the incumbent's place among the fitted trials."""
        model, beta = self.model, self.confidence
        thresholds, signal = model.standard_thresholds, model.posteriors.signal[SAFETY]
        if beta >= 0:  # no promise is wanted
            return SafeMargins(model.counted(beta), thresholds, np.inf * signal)
        margin = np.array([p.smoothed[at] for p in model.safety]) - thresholds + model.taken_by_noise(beta)
        floors = thresholds + _KEPT * np.maximum(margin, 0.0)
        noise = model.posteriors.noise[SAFETY]
        unknown = _CAP**2 + noise / (1.0 + noise)  # the latter is what one measurement of a point leaves
        caps = signal * np.sqrt(unknown + noise)
        return SafeMargins(model.counted(beta), floors, caps)

    def _probes(self, n: int) -> FloatArray:
        """Distances of the probes, those of single trials as if they were a batch."""
        known = self.optimizer.inputs_of(np.flatnonzero(self.trials.initial))
        typical = float(np.median(pdist(known))) if len(known) > 1 else 0.0
        return np.geomspace(*_PROBES, max(n, _BATCH)) * (typical or 1.0)

    def _stuck(self, n: int) -> bool:
        """Whether nothing has been gained for some rounds."""
        return self._stalled >= _STALLED_ROUNDS * max(n, _BATCH)

    def _plan(self, place: int, n: int) -> tuple[float, float]:
        """Kappa and reach of the trial at a place of the round."""
        kappa = _KAPPAS[place] if place < len(_KAPPAS) else _KAPPAS[-1] * self.rng.random()
        if place == 0 or not self._stuck(n):
            return kappa, self.region.length
        return _FAR * max(kappa, 0.5), self.chart.high - self.chart.low

    def _finish(self, batch: Batch, n: int) -> Proposal:
        """The proposal; what is missing are the most probably safe candidates."""
        chosen = np.array(batch.chosen).reshape(-1, self.chart.dimension)
        points = chosen if len(chosen) == n else np.concatenate([chosen, batch.others(n - len(chosen))])
        policy = self.optimizer.settings.empty_safe_set
        rows = complete_batch(np.arange(len(chosen)), n, points, self.model, policy)
        marked = ~(batch.margins.hold(batch.posteriors, points[rows]) | (rows < len(chosen)))
        ids = len(self.trials) + np.arange(len(rows))
        self.expectations.expect(ids, points[rows], self.model)
        incumbent = self.optimizer.space.to_unit(self.trials.z[[self.optimizer.centre_row()]])[0]
        full = self.chart.points(points[rows], np.clip(incumbent, 0.0, 1.0))
        return Proposal(full, trust_region_length=self.region.length, marked_unsafe=marked)

    def finish_round(self, trials: Trials) -> None:
        """The region follows violations, trust in the models their errors."""
        functions = self.optimizer.problem.safety
        self.expectations.learn(trials.id, modelled_safety(functions, trials.safety))
        promised = trials.completed & ~trials.marked_unsafe
        violated = bool((promised & ~self.optimizer.feasible[trials.id]).any())
        if (self.trials.round[: trials.id[0]] > 0).sum() >= _BATCH:  # no probe
            self.region = safe_update(self.region, not violated, self.rule)
        values = self.trials.objective[self.own]
        best = values.max(initial=-np.inf)
        gained = len(values) and (np.isinf(self._best) or best - self._best > _GAIN * values.std())
        self._stalled = 0 if gained else self._stalled + len(trials)
        self._best = float(best)

    def state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """With expectations and chart, and how long nothing was gained."""
        state, _ = super().state()
        best = float(self._best) if np.isfinite(self._best) else None
        return state | {
            "best": best,
            "stalled": self._stalled,
        }, self.expectations.arrays() | self.chart.arrays()

    def restore(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `state` gave."""
        super().restore(state, arrays)
        self._best = -np.inf if state["best"] is None else state["best"]
        self._stalled = state["stalled"]
        self.expectations.restore(arrays)
        self.chart.restore(arrays)
