"""BoTorch's own constrained method, to compare with: noisy expected improvement by Monte Carlo (qLogNEI).

Models, acquisition function and its optimiser are BoTorch's, with their defaults: `SingleTaskGP` for every
outcome, `qLogNoisyExpectedImprovement` with the constraints, points of a batch one after another (Ament et
al., Unexpected improvements to expected improvement for Bayesian optimization, NeurIPS 2023; Daulton et al.,
NeurIPS 2021).
"""

from __future__ import annotations

import warnings

import numpy as np

from hdsafebo.typing import FloatArray

RESTARTS, RAW_SAMPLES = 10, 512
"""Of the acquisition function's ascents: the values of BoTorch's tutorials."""


class QLogNei:
    """Asks for and is told of points of a box.

    Args:
        bounds: (2, D).
        seed: of PyTorch's generator.
    """

    def __init__(self, bounds: FloatArray, seed: int) -> None:
        self._bounds = bounds
        self._seed = seed
        self._x = np.empty((0, bounds.shape[1]))
        self._y = np.empty((0, 0))

    def tell(self, x: FloatArray, objective: FloatArray, slack: FloatArray) -> None:
        """Add (n, D) inputs with their (n,) objectives and (n, m) slacks."""
        unit = (x - self._bounds[0]) / (self._bounds[1] - self._bounds[0])
        y = np.column_stack([objective, slack])
        self._x = np.vstack([self._x, unit])
        self._y = np.vstack([self._y, y]) if self._y.size else y

    def ask(self, n: int) -> FloatArray:
        """(n, D) inputs."""
        import torch
        from botorch.acquisition.logei import qLogNoisyExpectedImprovement
        from botorch.acquisition.objective import GenericMCObjective
        from botorch.fit import fit_gpytorch_mll
        from botorch.models import ModelListGP, SingleTaskGP
        from botorch.optim import optimize_acqf
        from gpytorch.mlls import SumMarginalLogLikelihood

        with torch.random.fork_rng(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            torch.manual_seed(self._seed * 10_000 + len(self._x))
            x = torch.from_numpy(self._x)
            model = ModelListGP(*(SingleTaskGP(x, torch.from_numpy(y)[:, None].clone()) for y in self._y.T))
            fit_gpytorch_mll(SumMarginalLogLikelihood(model.likelihood, model))
            acquisition = qLogNoisyExpectedImprovement(
                model,
                x,
                objective=GenericMCObjective(lambda y, X=None: y[..., 0]),
                constraints=[lambda y, j=j: -y[..., j] for j in range(1, self._y.shape[1])],
                prune_baseline=True,
            )
            unit, _ = optimize_acqf(
                acquisition,
                bounds=torch.stack([torch.zeros(x.shape[1]), torch.ones(x.shape[1])]).double(),
                q=n,
                num_restarts=RESTARTS,
                raw_samples=RAW_SAMPLES,
                sequential=True,
            )
        return np.asarray(self._bounds[0] + unit.numpy() * (self._bounds[1] - self._bounds[0]))
