"""What was expected of asked trials, and how far off that was: the record by which a model is trusted.

Each error is counted in what was expected, posterior deviation and noise of an observation together, so that
a noisy observation is not taken for an error of the model. The noise is the larger of what was believed then
and what is believed now: before two trials lie close to each other, no model can know of noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdsafebo.gp.warp import Warp
from hdsafebo.gp.warped_fit import Standard
from hdsafebo.gp.warped_process import WarpedProcess
from hdsafebo.gp.warped_surrogate import SAFETY, WarpedSurrogate
from hdsafebo.typing import FloatArray, IntArray

_REMEMBERED = 20
"""Last trials whose errors count: a model that has become better is trusted again."""
_USUAL = 2.0
"""Largest of so many errors that a correct model makes about; beyond it deviations are inflated."""
_LARGEST = 30.0
"""Beyond, no bound holds anywhere; the next twenty trials could not mend it."""
_COLUMNS = 7  # centre, scale, shift, unit of the standardisation; mean; variance; noise variance
_KEPT = 5  # error, variance, noise variance, all in the units of the warped values; slope of the warp; value


class Expectations:
    """Of trials without a result, and the errors of those that have one.

    Args:
        count: number of modelled safety functions.
    """

    def __init__(self, count: int) -> None:
        self._ids = np.empty(0, np.int64)
        self._expected = np.empty((0, count, _COLUMNS))
        self._errors = np.empty((0, count, _KEPT))

    def inflation(self, safety: Sequence[WarpedProcess]) -> FloatArray:
        """(m,) factors of the models' deviations: 1 unless one of the last errors was larger than usual.

        Args:
            safety: the present models, which say how noisy observations are.
        """
        factors = np.ones(len(safety))
        for j, process in enumerate(safety if len(self._errors) else ()):
            error, variance, noise, slope, value = self._errors[:, j].T
            now = np.array([slope_at(process.outcomes.warp, v) for v in value])
            present = process.noise_variance * process.outcomes.unit**2 * (slope / now) ** 2
            noise = np.maximum(noise, present)
            factors[j] = np.max(np.abs(error) / np.sqrt(variance + noise)) / _USUAL
        return np.clip(factors, 1.0, _LARGEST)

    def expect(self, ids: IntArray, points: FloatArray, surrogate: WarpedSurrogate) -> None:
        """Remember what is expected at the (k, d) points of the trials `ids`."""
        mean, deviation = surrogate.posteriors.over(points, SAFETY)
        rows = np.empty((len(ids), *self._expected.shape[1:]))
        for j, process in enumerate(surrogate.safety):
            outcomes = process.outcomes
            rows[:, j, :4] = outcomes.warp.centre, outcomes.warp.scale, outcomes.shift, outcomes.unit
            rows[:, j, 4] = mean[j]
            rows[:, j, 5] = deviation[j] ** 2 - process.predicted_noise * process.variance
            rows[:, j, 6] = process.noise_variance
        other = ~np.isin(self._ids, ids)  # of proposals that were not asked in the end nothing stays
        self._ids, self._expected = self._ids[other], self._expected[other]
        self._ids = np.concatenate([self._ids, ids])
        self._expected = np.concatenate([self._expected, rows])

    def learn(self, ids: IntArray, safety: FloatArray) -> None:
        """Compare with the results: (k, m) modelled safety values of the trials `ids`, NaN without one."""
        errors = []
        for number, values in zip(ids, safety, strict=True):
            row = np.flatnonzero(self._ids == number)
            if len(row) and np.isfinite(values).all():
                errors.append([_error(e, y) for e, y in zip(self._expected[row[0]], values, strict=True)])
        keep = ~np.isin(self._ids, ids)
        self._ids, self._expected = self._ids[keep], self._expected[keep]
        if errors:
            self._errors = np.concatenate([self._errors, np.array(errors)])[-_REMEMBERED:]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Everything, by name."""
        return {"expected_ids": self._ids, "expected": self._expected, "errors": self._errors}

    def restore(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `arrays` gave.

        Raises:
            ValueError: they have other columns, as those of other versions.
        """
        for name, now in (("expected", self._expected), ("errors", self._errors)):
            if arrays[name].shape[1:] != now.shape[1:]:
                raise ValueError(f"{name} has shape {arrays[name].shape}; expected (n, *{now.shape[1:]})")
        self._ids, self._expected = arrays["expected_ids"], arrays["expected"]
        self._errors = arrays["errors"]


def slope_at(warp: Warp, value: float) -> float:
    """Derivative of a warp."""
    return float(np.exp(warp.log_jacobian(np.array([value]))))


def _error(expected: FloatArray, value: float) -> tuple[float, float, float, float, float]:
    """What is kept of an observation."""
    centre, scale, shift, unit, mean, variance, noise = (float(v) for v in expected)
    standard = Standard(Warp(centre, scale), shift, unit)
    error = unit * (float(standard.apply(np.array([value]))[0]) - mean)
    return error, unit**2 * variance, unit**2 * noise, slope_at(standard.warp, value), value
