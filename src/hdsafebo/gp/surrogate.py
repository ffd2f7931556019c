"""What the optimiser believes of the objective and of the safety functions.

The only place that knows standardisation, noise, length scales, and what mu + beta * sigma means. The classes
and functions here work on kernel inputs: whatever space the caller measures distances in.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from hdsafebo.errors import SurrogateError
from hdsafebo.gp.fit import NoisePrior, fit_gaussian_process
from hdsafebo.gp.gaussian_process import GaussianProcess, Hyperparameters
from hdsafebo.gp.kernel import exact_distances
from hdsafebo.gp.safe_set import safe_probabilities, violation_bound
from hdsafebo.problem import Safety
from hdsafebo.typing import BoolArray, FloatArray, Shaped

_COMPLETES = 0.5
"""Threshold between failed (0) and completed (1)."""
_FAILURES = NoisePrior(mode=1e-3, spread=1.0, least=1e-5, most=0.03, first=(1e-3,))
"""A larger noise would explain each failure as an accident that says nothing of its neighbours."""


class DistanceCache:
    """Distances between the rows of a table that mostly grows at its end, as if computed anew, to the bit."""

    def __init__(self) -> None:
        # One attribute, so that no interrupt finds the inputs of one table beside the distances of another.
        self._known = np.empty((0, 0)), np.empty((0, 0))

    def of(self, inputs: Shaped[FloatArray, "n p"]) -> Shaped[FloatArray, "n n"]:
        """(n, n) distances between the rows of (n, p) kernel inputs; not to be written to."""
        earlier, distances = self._known
        known = len(earlier)
        if not (known and known <= len(inputs) and np.array_equal(earlier, inputs[:known])):
            known = 0
        if known < len(inputs):
            grown = np.empty((len(inputs), len(inputs)))
            grown[:known, :known] = distances[:known, :known]
            grown[known:] = exact_distances(inputs[known:], inputs)
            grown[:known, known:] = grown[known:, :known].T
            self._known, distances = (inputs.copy(), grown), grown
        return distances


@dataclass(frozen=True)
class SurrogateState:
    """Where the fits of all functions stand: what a later fit starts from."""

    objective: Hyperparameters
    safety: tuple[Hyperparameters, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {"objective": asdict(self.objective), "safety": [asdict(h) for h in self.safety]}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> SurrogateState:
        """The state that `to_json` wrote.

        Raises:
            ValueError, TypeError, KeyError: it is none.
        """

        def read(entry: dict[str, Any]) -> Hyperparameters:
            hyper = Hyperparameters(**(entry | {"steps": tuple(entry["steps"])}))
            positive = (hyper.length_scale, hyper.noise_ratio, hyper.reference, *hyper.steps)
            counts = (hyper.fits, hyper.jitters, hyper.fallbacks)
            if not (np.isfinite(positive).all() and min(positive) > 0 and min(counts) >= 0):
                raise ValueError(f"hyper-parameters {hyper} hold a number out of its range")
            return hyper

        return cls(read(data["objective"]), tuple(read(entry) for entry in data["safety"]))


class Beliefs(ABC):
    """What every model of the objective and the safety functions says; points are its kernel inputs.

    Attributes:
        objective: model of the objective, with `predict` and `predict_mean`.
        safety: one model per modelled safety function, in the problem's order.
        thresholds: (m,) of the modelled safety functions, in the units of their models (after `transform`).
    """

    objective: Any
    safety: tuple[Any, ...]
    thresholds: FloatArray

    @property
    @abstractmethod
    def state(self) -> Any:
        """What the next fit starts from."""

    @property
    @abstractmethod
    def inputs(self) -> FloatArray:
        """(n, p) kernel inputs of the data."""

    @property
    @abstractmethod
    def length_scale(self) -> float:
        """The distance over which anything is known to vary little."""

    @abstractmethod
    def predict_safety(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(k, m) what is expected of the safety functions and how uncertain that is, at (k, p) points."""

    @abstractmethod
    def believed_safe(self, x: FloatArray, beta: float) -> BoolArray:
        """(k,) True where every safety function's bound meets its threshold."""

    @abstractmethod
    def safe_probabilities(self, x: FloatArray) -> FloatArray:
        """(k, m) probability that each modelled safety function meets its threshold."""

    def safe_probability(self, x: FloatArray) -> FloatArray:
        """(k,) probability that all of them do; they are modelled independently."""
        return np.asarray(self.safe_probabilities(x).prod(axis=1))

    @abstractmethod
    def violation_bound(self, x: FloatArray, beta: float | None) -> FloatArray:
        """(k,) bound on the expected violation (see `safe_set.violation_bound`), in the models' units."""


@dataclass(frozen=True)
class Surrogate(Beliefs):
    """Independent Gaussian processes of the objective and of each modelled safety function.

    Attributes:
        objective: model of the objective.
        safety: one model per modelled safety function, in the problem's order; then, where failed trials
            teach, one of whether a trial completes (1) or fails (0).
        thresholds: (m,) of these, in the units of their models (after `transform`).
        completion: whether that last one is there.
    """

    objective: GaussianProcess
    safety: tuple[GaussianProcess, ...]
    thresholds: Shaped[FloatArray, " m"]
    completion: bool = False

    @property
    def measured(self) -> int:
        """Number of safety functions that are measured quantities."""
        return len(self.safety) - self.completion

    @property
    def state(self) -> SurrogateState:
        """What the next fit starts from."""
        return SurrogateState(self.objective.hyper, tuple(gp.hyper for gp in self.safety))

    @property
    def inputs(self) -> Shaped[FloatArray, "n p"]:
        """(n, p) kernel inputs of the data."""
        return self.objective.inputs

    @property
    def length_scale(self) -> float:
        """The shortest fitted length scale: the distance over which anything is known to vary little."""
        return min(gp.length_scale for gp in (self.objective, *self.safety))

    def predict_safety(
        self, x: Shaped[FloatArray, "k p"]
    ) -> tuple[Shaped[FloatArray, "k m"], Shaped[FloatArray, "k m"]]:
        """(k, m) posterior means and deviations of the safety functions at (k, p) kernel inputs."""
        predictions = [gp.predict(x) for gp in self.safety]
        return np.column_stack([p[0] for p in predictions]), np.column_stack([p[1] for p in predictions])

    def slack(self, x: Shaped[FloatArray, "k p"], beta: float) -> Shaped[FloatArray, " k"]:
        """(k,) least of (mu + beta * sigma - h) / prior deviation over safety functions."""
        mean, deviation = self.predict_safety(x)
        scale = np.array([gp.signal_deviation for gp in self.safety])
        return np.asarray(((mean + beta * deviation - self.thresholds) / scale).min(axis=1))

    def slack_with_gradient(
        self, x: Shaped[FloatArray, "k p"], beta: float
    ) -> tuple[Shaped[FloatArray, " k"], Shaped[FloatArray, "k p"]]:
        """`slack`, (k,), and its gradient (k, p): that of the safety function nearest to its threshold."""
        rows = np.arange(len(x))
        slacks, gradients = [], []
        for gp, threshold in zip(self.safety, self.thresholds, strict=True):
            mean, deviation, mean_gradient, deviation_gradient = gp.predict_with_gradient(x)
            slacks.append((mean + beta * deviation - threshold) / gp.signal_deviation)
            gradients.append((mean_gradient + beta * deviation_gradient) / gp.signal_deviation)
        nearest = np.argmin(slacks, axis=0)
        return np.array(slacks)[nearest, rows], np.array(gradients)[nearest, rows]

    def believed_safe(self, x: Shaped[FloatArray, "k p"], beta: float) -> Shaped[BoolArray, " k"]:
        """(k,) True where mu + beta * sigma >= h for every safety function.

        Sigma lies between 0 and the prior deviation (with the noise of a measurement added to both, where
        that is predicted), so the mean alone decides most points; the rest, and only they, cost a triangular
        solve.
        """
        safe = np.ones(len(x), bool)
        for gp, threshold in zip(self.safety, self.thresholds, strict=True):
            rows = np.flatnonzero(safe)
            if len(rows) == 0:
                break
            correlation = gp.correlation(x[rows])
            mean = gp.outcomes.restore(gp.mean + correlation @ gp.weights)
            limits = gp.signal_deviation * np.sqrt(gp.predicted_noise + np.array([0.0, 1.0]))
            ends = np.sort(beta * limits) + mean[:, None] - threshold
            undecided = (ends[:, 0] < 0) & (ends[:, 1] >= 0)
            passed = ends[:, 0] >= 0
            passed[undecided] = mean[undecided] + beta * gp.deviation(correlation[undecided]) >= threshold
            safe[rows[~passed]] = False
        return safe

    def safe_probabilities(self, x: Shaped[FloatArray, "k p"]) -> Shaped[FloatArray, "k m"]:
        """(k, m) probability that each modelled safety function meets its threshold."""
        return safe_probabilities(*self.predict_safety(x), self.thresholds)

    def violation_bound(self, x: Shaped[FloatArray, "k p"], beta: float | None) -> Shaped[FloatArray, " k"]:
        """(k,) bound on the expected violation (see `safe_set.violation_bound`), in the models' units."""
        mean, deviation = (values[:, : self.measured] for values in self.predict_safety(x))
        return violation_bound(mean, deviation, self.thresholds[: self.measured], beta)


def modelled_safety(
    functions: Sequence[Safety], values: Shaped[FloatArray, "n m"]
) -> Shaped[FloatArray, "n q"]:
    """(n, m') columns of the (n, m) safety values that are modelled, transformed."""
    return np.column_stack(
        [apply_transform(s.transform, values[:, j]) for j, s in enumerate(functions) if s.modelled]
    )


def modelled_thresholds(functions: Sequence[Safety]) -> Shaped[FloatArray, " q"]:
    """(m',) thresholds of the modelled safety functions, transformed along with the values."""
    return np.array(
        [apply_transform(s.transform, np.array([s.threshold]))[0] for s in functions if s.modelled]
    )


def apply_transform(transform: Callable[[FloatArray], FloatArray] | None, values: FloatArray) -> FloatArray:
    """Values as they are modelled."""
    return values if transform is None else np.asarray(transform(values), float)


def fit_surrogate(
    inputs: Shaped[FloatArray, "n p"],
    objective: Shaped[FloatArray, " n"],
    safety: Shaped[FloatArray, "n m"],
    thresholds: Shaped[FloatArray, " m"],
    *,
    start: SurrogateState | None = None,
    cache: DistanceCache | None = None,
    noise: NoisePrior | None = None,
    known_noise: Shaped[FloatArray, "n e"] | None = None,
    refine: bool = True,
) -> Surrogate:
    """Fit all Gaussian processes.

    Args:
        inputs: (n, p) kernel inputs of completed trials.
        objective: (n,) outcomes.
        safety: (n, m) modelled safety values, already transformed.
        thresholds: (m,) transformed thresholds.
        start: of the last fit.
        cache: distances of an earlier call.
        noise: prior of the noise ratios.
        known_noise: (n, 1 + m) standard deviations of the noise of objective and safety values; a function
            with a NaN among its own has an unknown noise. What is predicted of a safety function with known
            noise is its next measurement, which decides whether a trial was safe; otherwise the function.
        refine: False keeps the hyper-parameters of `start`, if there are any.

    Raises:
        SurrogateError: a process cannot be fitted, not even with the last good hyper-parameters, or the
            inputs have no finite distances.
    """
    distances = (cache or DistanceCache()).of(inputs)
    if not np.isfinite(distances).all():
        raise SurrogateError(
            f"distances between the kernel inputs of {len(inputs)} trials are not finite; expected inputs "
            "(codes or features) that are finite and whose squares are"
        )
    measured = safety.shape[1]
    starts = (None,) * (1 + measured) if start is None else (start.objective, *start.safety[:measured])
    outcomes = [objective, *safety.T]
    known = [None] * len(outcomes) if known_noise is None else [_known(column) for column in known_noise.T]
    processes = [
        fit_gaussian_process(
            inputs,
            distances,
            np.ascontiguousarray(y),
            start=s,
            noise=noise,
            known_noise=k,
            refine=refine,
        )
        for y, s, k in zip(outcomes, starts, known, strict=True)
    ]
    # A threshold goes through the same drawing-in as the values, so that it keeps its place among them.
    processes = [processes[0], *map(_of_measurements, processes[1:])]
    shown = [
        gp.outcomes.restore(gp.outcomes.standardise(np.array([h])))[0]
        for gp, h in zip(processes[1:], thresholds, strict=True)
    ]
    return Surrogate(processes[0], tuple(processes[1:]), np.array(shown))


def with_completion(
    surrogate: Surrogate, inputs: Shaped[FloatArray, "n p"], start: SurrogateState | None
) -> Surrogate:
    """The surrogate with one more safety function: whether a trial completes.

    Failures have no safety values, so a process of its own takes 1 for each completed trial and 0 for each
    failed one, with a threshold between the two. Failures are no noise: where one trial failed, a next one is
    expected to.

    Args:
        surrogate: fitted to the completed trials.
        inputs: (n, p) kernel inputs of the completed trials, then of the failed ones.
        start: of the last fit.

    Raises:
        SurrogateError: the process cannot be fitted.
    """
    completes = (np.arange(len(inputs)) < len(surrogate.inputs)).astype(float)
    earlier = () if start is None else start.safety[surrogate.measured :]
    process = fit_gaussian_process(
        inputs,
        exact_distances(inputs, inputs),
        completes,
        start=earlier[0] if earlier else None,
        noise=_FAILURES,
    )
    return replace(
        surrogate,
        safety=(*surrogate.safety, process),
        thresholds=np.append(surrogate.thresholds, _COMPLETES),
        completion=True,
    )


def _of_measurements(gp: GaussianProcess) -> GaussianProcess:
    """Where the noise is known, the process that predicts the next measurement."""
    return gp if gp.relative_noise is None else replace(gp, predicted_noise=gp.hyper.noise_ratio)


def _known(deviations: Shaped[FloatArray, " n"]) -> Shaped[FloatArray, " n"] | None:
    """The standard deviations, when all of them are known."""
    return None if np.isnan(deviations).any() else deviations
