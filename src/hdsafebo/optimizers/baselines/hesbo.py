"""HeSBO: expected improvement in a random count-sketch subspace."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from hdsafebo.gp.ard import TRUST_REGION
from hdsafebo.gp.ard_process import ArdProcess
from hdsafebo.optimizers.baselines.count_sketch import CountSketch
from hdsafebo.optimizers.baselines.subspace import SubspaceOptimizer
from hdsafebo.optimizers.settings import OptimizerSettings
from hdsafebo.search.acquisition import Acquisition, log_expected_improvement, maximise
from hdsafebo.search.candidates import sobol_points
from hdsafebo.typing import FloatArray

_DEFAULT_DIMENSION = 20
_STARTS = 4
_RAW = 512


class HesboSettings(OptimizerSettings):
    """Settings of `hesbo`.

    Attributes:
        dimension: of the subspace; None takes that of the embedding which the other methods search (as the
            paper does), and 20 where there is none.
    """

    dimension: int | None = Field(default=None, ge=1)


class Hesbo(SubspaceOptimizer[HesboSettings]):
    """Hashing-enhanced subspace Bayesian optimisation (Nayebi, Munteanu and Poloczek, ICML 2019).

    Every input follows one of d latent coordinates, up to sign, both drawn at random; the map has the
    box as its image, so nothing is clipped. A Matern-5/2 process with a length scale per latent coordinate
    and expected improvement, as in their HeSBO-EI. The points of a batch are chosen one after another,
    each as if the outcomes of those before it, and of those under evaluation, were their means.
    """

    name = "hesbo"
    Settings = HesboSettings

    def first_sketch(self) -> CountSketch:
        """Bins and signs at random."""
        inputs = self.problem.bounds.shape[1]
        dimension = self.settings.dimension
        if dimension is None and self.codec is not None:
            middle = self.problem.bounds.mean(axis=0, keepdims=True)
            dimension = np.asarray(self.codec.encode(middle)).shape[1]
        return CountSketch.random(inputs, min(dimension or _DEFAULT_DIMENSION, inputs), self.rng)

    def propose_latent(self, y: FloatArray, objective: FloatArray, n: int) -> tuple[FloatArray, float]:
        """n greedy maxima of expected improvement."""
        process = self._warm.process("objective", y, objective, TRUST_REGION)
        best, d = float(objective.max()), y.shape[1]
        incumbent = y[[np.argmax(objective)]]
        chosen = np.empty((0, d))
        waiting = self.waiting()
        if len(waiting):
            best = max(best, float(process.predict(waiting)[0].max()))
        for _ in range(n):
            acquisition = improvement(process.believing(np.vstack([waiting, chosen])), best)
            raw = np.vstack([sobol_points(_RAW, d, self.rng), self._around(incumbent)])
            starts = raw[np.argsort(-acquisition(raw)[0], kind="stable")[:_STARTS]]
            point, _ = maximise(acquisition, starts, np.zeros(d), np.ones(d))
            chosen = np.vstack([chosen, point])
            best = max(best, float(process.predict(point[None])[0][0]))
        return chosen, np.nan

    def _around(self, point: FloatArray) -> FloatArray:
        """(64, d) points near one."""
        steps = 0.05 * self.rng.standard_normal((64, point.shape[1]))
        return np.clip(point + steps, 0.0, 1.0)


def improvement(process: ArdProcess, best: float) -> Acquisition:
    """Log expected improvement over `best` and its gradient."""

    def acquisition(q: FloatArray) -> tuple[FloatArray, FloatArray]:
        mean, sd, pullback = process.predict_with_pullback(q)
        value, by_mean, by_sd = log_expected_improvement(mean, sd, best)
        return value, pullback(by_mean, by_sd)

    return acquisition
