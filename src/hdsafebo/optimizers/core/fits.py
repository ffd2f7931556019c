"""Fits of the surrogate from round to round: each starts where the one of the round before ended.

A fit that someone reads between two rounds (to plot the model, say) starts no later one, so that looking at
an optimiser does not change what it does next.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdsafebo.gp.fit import NoisePrior
from hdsafebo.gp.surrogate import (
    Beliefs,
    DistanceCache,
    Surrogate,
    SurrogateState,
    fit_surrogate,
    modelled_safety,
    modelled_thresholds,
    with_completion,
)
from hdsafebo.gp.warped_surrogate import WarpedState
from hdsafebo.problem import Problem
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import FloatArray, IntArray

State = SurrogateState | WarpedState
Fit = Callable[[State | None, DistanceCache], Beliefs]
_COUNTED = ("fits", "jitters", "fallbacks")


@dataclass(frozen=True)
class FitCounts:
    """Fits of the processes of all functions together, as rounds were asked with them.

    Attributes:
        fits: all of them.
        jitters: fits that needed a larger diagonal than the noise.
        fallbacks: fits that failed, so that the last good hyper-parameters were kept.
    """

    fits: int = 0
    jitters: int = 0
    fallbacks: int = 0


class Fits:
    """The current surrogate, made when it is first needed, and where the next fit starts."""

    def __init__(self) -> None:
        self._cache = DistanceCache()
        self._start: State | None = None
        self._next_start: State | None = None
        self._current: Beliefs | None = None

    def copy(self) -> Fits:
        """The same fits, which later calls of either leave as they are."""
        other = Fits()
        other._cache, other._start = self._cache, self._start
        other._next_start, other._current = self._next_start, self._current
        return other

    def current(self, fit: Fit) -> Beliefs:
        """The surrogate of the present data; `fit` makes it from a start and cached distances."""
        if self._current is None:
            self._current = fit(self._start, self._cache)
        return self._current

    def use(self) -> None:
        """A round was asked with the current surrogate, if there is one: the next fit starts from it."""
        if self._current is not None:
            self._next_start = self._current.state

    @property
    def counts(self) -> FitCounts:
        """Counts of the fits that were used; a saved state carries them on."""
        state = self._start if self._next_start is None else self._next_start
        if state is None:
            return FitCounts()
        processes = (state.objective, *state.safety)
        return FitCounts(*(sum(getattr(h, name) for h in processes) for name in _COUNTED))

    def forget(self) -> None:
        """The data changed."""
        self._current = None
        if self._next_start is not None:
            self._start, self._next_start = self._next_start, None

    def to_json(self) -> dict[str, Any]:
        """What a later process needs to go on with the same fits."""
        return {
            "start": None if self._start is None else self._start.to_json(),
            "next_start": None if self._next_start is None else self._next_start.to_json(),
        }

    def restore(self, data: dict[str, Any]) -> None:
        """Take back what `to_json` gave."""
        start, next_start = data["start"], data["next_start"]
        self._start, self._next_start = _read(start), _read(next_start)
        self._current = None


def fit_trials(
    problem: Problem,
    trials: Trials,
    rows: IntArray,
    *,
    inputs_of: Callable[[IntArray], FloatArray],
    objective: FloatArray,
    noise: NoisePrior,
    refine: bool,
    start: State | None,
    cache: DistanceCache,
) -> Surrogate:
    """The surrogate of some completed trials, and of whether inputs give a result where failures teach.

    Args:
        problem: of the trials.
        trials: all of them.
        rows: (k,) the completed ones to fit.
        inputs_of: gives the (k, p) kernel inputs of rows: what the kernel measures distances between.
        objective: (k,) what the objective's process is fitted to.
        noise: prior of the noise.
        refine: False keeps the hyper-parameters of `start`.
        start: of the last fit.
        cache: distances of earlier fits.
    """
    assert not isinstance(start, WarpedState), "the fits of a method are of one kind"
    surrogate = fit_surrogate(
        inputs_of(rows),
        objective,
        modelled_safety(problem.safety, trials.safety[rows]),
        modelled_thresholds(problem.safety),
        start=start,
        cache=cache,
        noise=noise,
        refine=refine,
        known_noise=known_noise(
            problem, trials.noise[rows], np.array_equal(objective, trials.objective[rows])
        ),
    )
    failed = np.flatnonzero(trials.status == Status.FAILED)
    if not problem.failures_teach or len(failed) == 0:
        return surrogate
    inputs = np.concatenate([surrogate.inputs, inputs_of(failed)])
    return with_completion(surrogate, inputs, start)


def known_noise(problem: Problem, told: FloatArray, in_units: bool) -> FloatArray:
    """(n, 1 + m') known standard deviations of the objective and the modelled safety functions.

    Args:
        problem: of the trials.
        told: (n, 1 + m) of the trials that are fitted, NaN where nothing was told.
        in_units: the objective is modelled in its own units, which are those of its noise.
    """
    noise = told.copy()
    if problem.noise is not None:
        noise = np.where(np.isnan(noise), problem.noise, noise)
    if not in_units:
        noise[:, 0] = np.nan
    modelled = [j + 1 for j, s in enumerate(problem.safety) if s.modelled]
    return noise[:, [0, *modelled]]


def _read(data: dict[str, Any] | None) -> State | None:
    if data is None:
        return None
    return (WarpedState if "warped" in data else SurrogateState).from_json(data)
