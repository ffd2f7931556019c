"""What is believed where the inputs themselves are modelled: warped processes, and how far to trust them.

A model that was just wrong is not asked to promise: the deviations of each safety function are multiplied by
how far its recent predictions were off (`inflation`), and what `beta` demands is counted in such deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from hdsafebo.errors import SurrogateError
from hdsafebo.gp.surrogate import Beliefs
from hdsafebo.gp.warp import warp_scales
from hdsafebo.gp.warped_fit import WarpedFit, first_fit, fit_warped
from hdsafebo.gp.warped_process import Posteriors, WarpedProcess
from hdsafebo.typing import FloatArray

_DISTRUST = 1.5
"""Deviations count as so much larger where beta is negative: fitted hyper-parameters have errors, too."""
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(24)
"""Quadrature for the standard normal distribution."""
SAFETY = slice(1, None)
"""Of all functions, the objective first, those that decide on safety."""


@dataclass(frozen=True)
class WarpedState:
    """Where the fits of all functions stand: what a later fit starts from."""

    objective: WarpedFit
    safety: tuple[WarpedFit, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain data; infinity, which JSON lacks, becomes null."""

        def plain(fit: WarpedFit) -> dict[str, Any]:
            return asdict(fit) | {"warp_scale": None if np.isinf(fit.warp_scale) else fit.warp_scale}

        return {"warped": True, "objective": plain(self.objective), "safety": [plain(f) for f in self.safety]}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> WarpedState:
        """The state that `to_json` wrote."""

        def read(entry: dict[str, Any]) -> WarpedFit:
            scale = np.inf if entry["warp_scale"] is None else entry["warp_scale"]
            lists = {key: tuple(entry[key]) for key in ("log_length_scales", "warp_scales")}
            return WarpedFit(**(entry | lists | {"warp_scale": scale}))

        return cls(read(data["objective"]), tuple(read(entry) for entry in data["safety"]))


@dataclass(frozen=True)
class WarpedSurrogate(Beliefs):
    """Warped processes of the objective and of each modelled safety function.

    Attributes:
        objective: model of the objective.
        safety: one model per modelled safety function, in the problem's order.
        thresholds: (m,) of the modelled safety functions, in the units of their models (after `transform`).
        inflation: (m,) factors of the safety functions' deviations, at least 1.
    """

    objective: WarpedProcess
    safety: tuple[WarpedProcess, ...]
    thresholds: FloatArray
    inflation: FloatArray

    @property
    def state(self) -> WarpedState:
        """What the next fit starts from."""
        return WarpedState(self.objective.fit, tuple(p.fit for p in self.safety))

    @property
    def inputs(self) -> FloatArray:
        """(n, d) points of the data."""
        return self.objective.inputs

    @property
    def length_scale(self) -> float:
        """The shortest of the processes' geometric mean length scales."""
        return min(p.length_scale for p in (self.objective, *self.safety))

    @cached_property
    def posteriors(self) -> Posteriors:
        """Of the objective, and after it of all safety functions."""
        return Posteriors([self.objective, *self.safety])

    @cached_property
    def standard_thresholds(self) -> FloatArray:
        """(m,) as the models see them."""
        pairs = zip(self.safety, self.thresholds, strict=True)
        return np.array([float(p.outcomes.apply(np.array([h]))[0]) for p, h in pairs])

    def counted(self, beta: float) -> FloatArray:
        """(m,) multiples of the models' deviations that beta stands for."""
        return beta * self.inflation * (_DISTRUST if beta < 0 else 1.0)

    def taken_by_noise(self, beta: float) -> FloatArray:
        """(m,) what the noise of a measurement alone takes from the bounds where beta is negative."""
        return self.counted(beta) * self.posteriors.signal[SAFETY] * np.sqrt(self.posteriors.noise[SAFETY])

    def predict_safety(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(k, m) medians and deviations of the safety functions, in their units, at (k, d) points."""
        predictions = [p.predict(x) for p in self.safety]
        return np.column_stack([p[0] for p in predictions]), np.column_stack([p[1] for p in predictions])

    def slack(self, x: FloatArray, beta: float) -> FloatArray:
        """(k,) least of (mu + beta * sigma - h) / prior deviation, standardised, over safety functions."""
        mean, deviation = self.posteriors.over(x, SAFETY)
        margin = mean + self.counted(beta)[:, None] * deviation - self.standard_thresholds[:, None]
        return np.asarray((margin / self.posteriors.signal[SAFETY, None]).min(axis=0))

    def believed_safe(self, x: FloatArray, beta: float) -> NDArray[np.bool_]:
        """(k,) True where mu + beta * sigma >= h for every safety function, standardised."""
        return self.slack(x, beta) >= 0

    def safe_probabilities(self, x: FloatArray) -> FloatArray:
        """(k, m) probability that each modelled safety function meets its threshold."""
        mean, deviation = self.posteriors.over(x, SAFETY)
        z = (mean - self.standard_thresholds[:, None]) / (deviation * self.inflation[:, None])
        return np.asarray(ndtr(z).T)

    def violation_bound(self, x: FloatArray, beta: float | None) -> FloatArray:
        """(k,) bound on the expected violation, in the models' units (see `safe_set.violation_bound`)."""
        mean, deviation = self.posteriors.over(x, SAFETY)
        total = np.zeros(len(x))
        for j, process in enumerate(self.safety):
            sd = deviation[j] * self.inflation[j]
            t = (self.standard_thresholds[j] - mean[j]) / sd
            t = t if beta is None else np.maximum(t, beta)
            drawn = self.standard_thresholds[j] + sd[:, None] * (_NODES - t[:, None])
            short = np.maximum(0.0, self.thresholds[j] - process.outcomes.restore(drawn))
            total += short @ _WEIGHTS / _WEIGHTS.sum()
        return total


def fit_warped_surrogate(
    inputs: FloatArray,
    objective: FloatArray,
    safety: FloatArray,
    thresholds: FloatArray,
    *,
    best: float,
    start: WarpedState | None = None,
    noise: FloatArray | None = None,
    least_noise: float = 0.0,
) -> WarpedSurrogate:
    """Fit all processes; nothing inflates their deviations.

    Args:
        inputs: (n, d) points of the unit cube, of completed trials.
        objective: (n,) outcomes.
        safety: (n, m) modelled safety values, already transformed.
        thresholds: (m,) transformed thresholds: the centres of the safety functions' warps.
        best: value of the objective that its warp is centred at.
        start: of the last fit.
        noise: (n, 1 + m) known standard deviations of objective and safety values, NaN where unknown. What is
            predicted of a safety function whose noise is known throughout is its next measurement.
        least_noise: see `fit_warped`.

    Raises:
        SurrogateError: a covariance cannot be factorised, or the inputs are not finite.
    """
    if not np.isfinite(inputs).all():
        raise SurrogateError(f"kernel inputs of {len(inputs)} trials are not all finite")
    columns = [np.ascontiguousarray(y) for y in (objective, *safety.T)]
    centres = [best, *thresholds]
    starts: Sequence[WarpedFit] = (
        [first_fit(inputs.shape[1], warp_scales(y, c)) for y, c in zip(columns, centres, strict=True)]
        if start is None
        else [start.objective, *start.safety]
    )
    known = np.full((len(inputs), len(columns)), np.nan) if noise is None else noise
    processes = []
    for j, (y, centre, begin, sd) in enumerate(zip(columns, centres, starts, known.T, strict=True)):
        fit, outcomes = fit_warped(inputs, y, centre, begin, sd, least_noise)
        measured = outcomes.variance(np.full(len(y), centre), sd) if j and np.isfinite(sd).all() else 0.0
        processes.append(WarpedProcess.of(inputs, y, fit, outcomes, measured))
    return WarpedSurrogate(processes[0], tuple(processes[1:]), thresholds, np.ones(len(thresholds)))
