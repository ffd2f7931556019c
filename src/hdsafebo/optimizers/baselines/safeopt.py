"""SafeOpt: expand a set that is certified safe, and maximise within it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.linalg import solve_triangular

from hdsafebo.errors import TrialError
from hdsafebo.gp.gaussian_process import GaussianProcess
from hdsafebo.gp.kernel import exact_distances, fast_distances, matern52
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.core.empty_set import complete_batch
from hdsafebo.optimizers.settings import SafeSetSettings
from hdsafebo.problem import encoded
from hdsafebo.search.candidates import sobol_points
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import FloatArray, IntArray

_SAME_POINT = 1e-9
"""In widths of the box: two points so near are one, whose code was rounded."""


class SafeOptSettings(SafeSetSettings):
    """Settings of `safeopt`.

    Attributes:
        beta: negative, so that mu + beta * sigma is the lower bound that certifies (the paper's 2).
        grid: points of the discretisation. SafeOpt needs a finite set; in high dimension no set of
            practical size is dense, which is why the method does not expand there.
    """

    beta: float = Field(default=-2.0, le=0)
    grid: int = Field(default=2000, ge=1)


class SafeOpt(Optimizer[SafeOptSettings]):
    """Safe exploration for optimisation with Gaussian processes (Sui, Gotovos, Burdick, Krause, ICML 2015).

    Their algorithm 1 on a fixed finite discretisation, in the form without a Lipschitz constant
    (Berkenkamp, Schoellig and Krause, ICRA 2016):

        S  the points whose lower bounds meet the thresholds, and every point that was safe when evaluated
        M  potential maximisers: points of S whose upper bound of f reaches the best lower bound in S
        G  potential expanders: points of S whose optimistic outcome would certify a point outside S
        x  the point of M and G with the widest confidence interval

    The later points of a batch are chosen as if the outcomes before them, and those that are still out, were
    their means; a point that is under evaluation is not proposed again. When nothing of
    the discretisation is certified, S holds evaluated points only, and the most uncertain of them are
    evaluated again: safe, and no progress. `expansion` records it. On a finite candidate set a
    candidate cannot be evaluated twice; `empty_safe_set` then decides.
    """

    name = "safeopt"
    Settings = SafeOptSettings

    def prepare(self) -> None:
        """Draw the discretisation."""
        self._seed = int(self.rng.integers(2**32))
        self.expansion: list[dict[str, int]] = []

    def propose(self, n: int) -> Proposal:
        """The n widest of the potential maximisers and expanders."""
        self.centre_row()  # explains what is missing
        points, rows = self._discretisation()
        seeds = np.empty((0, self.space.dimension))
        if rows is None:
            seeds = self.space.pinned(np.clip(self.space.to_unit(self.trials.z[self.feasible]), 0.0, 1.0))
        everything = np.vstack([points, seeds])
        inputs = self.inputs_at(everything)
        safe = self.surrogate.believed_safe(inputs, self.settings.confidence)
        certified = int(safe[: len(points)].sum())
        safe[len(points) :] = True
        inside = np.flatnonzero(safe)
        interesting, expanders = self._interesting(inputs, safe)
        self._record(len(points), certified, expanders)
        pending = self._under_evaluation(everything)
        free = np.flatnonzero(~pending)
        if len(free) == 0:
            raise TrialError(f"all {len(everything)} points that safeopt may propose are under evaluation")
        chosen = inside
        if len(inside):
            chosen = inside[_widest(self._views(inputs[inside]), interesting, n, pending[inside])]
        position = np.searchsorted(free, chosen)
        chosen = free[complete_batch(position, n, inputs[free], self.surrogate, self.settings.empty_safe_set)]
        marked = ~safe[chosen]
        if rows is not None:
            return Proposal(rows=rows[chosen], marked_unsafe=marked)
        return Proposal(everything[chosen], marked_unsafe=marked)

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Seed of the discretisation, and the record of the expansion."""
        return {"seed": self._seed, "expansion": self.expansion}, {}

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `method_state` gave."""
        self._seed, self.expansion = state["seed"], state["expansion"]

    @property
    def certified_points(self) -> int:
        """Points of the discretisation that the bounds certified, at most in any round."""
        return max((entry["certified"] for entry in self.expansion), default=0)

    def _discretisation(self) -> tuple[FloatArray, IntArray | None]:
        """(k, d) points in the unit cube, and their rows when only a finite set can be evaluated."""
        rng = np.random.default_rng(self._seed)
        candidates = self.problem.candidates
        if candidates is None:
            return self.space.pinned(sobol_points(self.settings.grid, self.space.dimension, rng)), None
        total = len(candidates)
        rows = rng.permutation(total)[: self.settings.grid]
        free = np.setdiff1d(rows, self.taken)
        if len(free) == 0:
            free = np.setdiff1d(np.arange(total), self.taken)[: self.settings.grid]
        x = candidates.inputs(free)
        z = x if self.embedding is None else encoded(self.embedding, x)
        return self.space.to_unit(z), free

    def _under_evaluation(self, points: FloatArray) -> NDArray[np.bool_]:
        """(k,) True for points of the unit cube whose own result is still out."""
        waiting = self.space.to_unit(self.trials.z[self.trials.status == Status.PENDING])
        if len(waiting) == 0:
            return np.zeros(len(points), bool)
        return np.asarray(exact_distances(points, waiting).min(axis=1) < _SAME_POINT)

    def keeps_promise(self, trials: Trials) -> NDArray[np.bool_]:
        """Certified, or an evaluated point that was safe."""
        promised = super().keeps_promise(trials)
        if not promised.all() and self.feasible.any():
            seen = self.space.to_unit(self.trials.z[self.feasible])
            again = exact_distances(self.space.to_unit(trials.z), seen).min(axis=1) < _SAME_POINT
            promised = promised | again
        return promised

    def _interesting(self, inputs: FloatArray, safe: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int]:
        """(s,) True for maximisers and expanders among the s safe points; the number of expanders."""
        inside, outside = inputs[safe], inputs[~safe]
        if len(inside) == 0:
            return np.zeros(0, bool), 0
        width = -self.settings.confidence
        mean, deviation = self.surrogate.objective.predict(inside)
        maximisers = np.asarray(mean + width * deviation >= (mean - width * deviation).max())
        expanders = np.zeros(len(inside), bool)
        if len(outside):
            certified = np.ones((len(inside), len(outside)), bool)
            for gp, threshold in zip(self.surrogate.safety, self.surrogate.thresholds, strict=True):
                certified &= _would_certify(gp, inside, outside, float(threshold), width)
            expanders |= certified.any(axis=1)
        return maximisers | expanders, int(expanders.sum())

    def _views(self, inputs: FloatArray) -> list[_View]:
        """What each process knows of the safe points."""
        return [_View.of(gp, inputs) for gp in (self.surrogate.objective, *self.surrogate.safety)]

    def _record(self, grid: int, certified: int, expanders: int) -> None:
        self.expansion.append(
            {"round": self.round + 1, "grid": grid, "certified": certified, "expanders": expanders}
        )


@dataclass
class _View:
    """Points as one process sees them, in units of its prior variance.

    Attributes:
        gp: the process.
        inputs: (k, p) kernel inputs.
        half: (n, k) solution of factor @ half = correlation.
        variance: (k,) posterior variances, updated as points are believed.
        believed: for each believed point the (k,) vector whose square its belief takes off the variances.
    """

    gp: GaussianProcess
    inputs: FloatArray
    half: FloatArray
    variance: FloatArray
    believed: list[FloatArray]

    @classmethod
    def of(cls, gp: GaussianProcess, inputs: FloatArray) -> _View:
        half = solve_triangular(gp.factor, gp.correlation(inputs).T, lower=True)
        variance = np.maximum(1.0 - np.einsum("ij,ij->j", half, half), 1e-12)
        return cls(gp, inputs, half, variance, [])

    def believe(self, j: int) -> None:
        """Take the variance that an observation of point j would take."""
        cross = matern52(fast_distances(self.inputs[[j]], self.inputs)[0], self.gp.length_scale)
        cross -= self.half[:, j] @ self.half
        for vector in self.believed:
            cross -= vector[j] * vector
        vector = cross / np.sqrt(self.variance[j] + self.gp.hyper.noise_ratio)
        self.believed.append(vector)
        self.variance = np.maximum(self.variance - vector * vector, 1e-12)


def _widest(
    views: list[_View], interesting: NDArray[np.bool_], n: int, pending: NDArray[np.bool_]
) -> IntArray:
    """At most n safe points, the interesting ones first, each the widest after those before it.

    Those that are under evaluation come before all others, and are not chosen.
    """
    for view in views:
        for waiting in np.flatnonzero(pending):
            view.believe(int(waiting))
    chosen: list[int] = []
    for _ in range(min(n, int((~pending).sum()))):
        width = np.max([view.variance for view in views], axis=0) + 2.0 * interesting
        width[pending] = -np.inf
        width[chosen] = -np.inf
        j = int(np.argmax(width))
        chosen.append(j)
        for view in views:
            view.believe(j)
    return np.array(chosen, np.int64)


def _would_certify(
    gp: GaussianProcess, inside: FloatArray, outside: FloatArray, threshold: float, width: float
) -> NDArray[np.bool_]:
    """(s, u) True where the upper bound, observed at a safe point, would certify an outer one."""
    near, far = _View.of(gp, inside), _View.of(gp, outside)
    covariance = matern52(fast_distances(inside, outside), gp.length_scale) - near.half.T @ far.half
    gain = covariance / (near.variance + gp.hyper.noise_ratio)[:, None]
    # The optimistic outcome lies `width` deviations above the mean.
    mean = gp.predict_mean(outside) + gp.signal_deviation * gain * width * np.sqrt(near.variance)[:, None]
    variance = np.maximum(far.variance - gain * covariance, 0.0)
    return np.asarray(mean - width * gp.signal_deviation * np.sqrt(variance) >= threshold)
