"""The loop of BoTorch's tutorial of SCBO, from BoTorch's own parts, to compare ours with on several seeds.

Model: Matern-5/2 with length scales in [0.005, 4], noise variance in [1e-8, 1e-3], standardised outcomes.
Batch: 2000 Sobol points of a box around the best feasible point (or the one of least violation), scored by
`ConstrainedMaxPosteriorSampling`. The side starts at 0.8, doubles (up to 1.6) after ten rounds in a row that
improve and halves after ceil(d / q) that do not; the run ends when it falls below 0.5^7
(https://botorch.org/docs/tutorials/scalable_constrained_bo).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from hdsafebo.typing import FloatArray

CANDIDATES = 2000
LONGEST, SHORTEST = 1.6, 0.5**7
SUCCESSES = 10

Function = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def tutorial_run(
    function: Function, x: FloatArray, batch: int, most: int, seed: int
) -> tuple[FloatArray, FloatArray]:
    """Run until the region collapses or `most` points are evaluated.

    Args:
        function: objective and (n, m) margins, feasible from 0 up, of (n, d) points of the unit cube.
        x: (n, d) points at the start.
        batch: points per round.
        most: evaluations after which the run is cut.
        seed: of candidates and samples.

    Returns:
        Objectives and margins of all evaluated points, in their order.
    """
    import torch
    from torch.quasirandom import SobolEngine

    d = x.shape[1]
    sobol = SobolEngine(d, scramble=True, seed=seed)
    objective, margins = function(x)
    length, successes, failures = 0.8, 0, 0
    # The tutorial starts without an incumbent: its first round counts as a success.
    best, best_violation = -np.inf, np.inf
    with torch.random.fork_rng(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.manual_seed(seed)
        while length >= SHORTEST and len(x) < most:
            centre = x[_best(objective, margins)]
            lower, upper = np.clip([centre - length / 2, centre + length / 2], 0.0, 1.0)
            candidates = lower + (upper - lower) * sobol.draw(CANDIDATES).double().numpy()
            fresh = _thompson(x, objective, margins, candidates, batch)
            values, slack = function(fresh)
            row = _best(values, slack)
            violation = np.maximum(0.0, -slack[row]).sum()
            if violation == 0:
                success = best_violation > 0 or values[row] > best + 1e-3 * abs(best)
            else:
                success = violation < best_violation
            if success:
                best, best_violation = values[row], violation
            successes, failures = (successes + 1, 0) if success else (0, failures + 1)
            if successes == SUCCESSES:
                length, successes = min(2.0 * length, LONGEST), 0
            elif failures == int(np.ceil(max(4.0, d) / batch)):
                length, failures = length / 2.0, 0
            x = np.vstack([x, fresh])
            objective, margins = np.append(objective, values), np.vstack([margins, slack])
    return objective, margins


def _best(objective: FloatArray, margins: FloatArray) -> int:
    """Row of the best feasible point, or of the one with the least total violation."""
    violation = np.maximum(0.0, -margins).sum(axis=1)
    if (violation == 0).any():
        return int(np.where(violation == 0, objective, -np.inf).argmax())
    return int(violation.argmin())


def _thompson(
    x: FloatArray, objective: FloatArray, margins: FloatArray, candidates: FloatArray, batch: int
) -> FloatArray:
    """(batch, d) candidates that BoTorch's constrained sampling takes."""
    import gpytorch
    import torch
    from botorch.generation.sampling import ConstrainedMaxPosteriorSampling
    from botorch.models import ModelListGP

    with gpytorch.settings.max_cholesky_size(float("inf")):
        models = [_fitted(x, outcome) for outcome in (objective, *(-margins.T))]
        sampling = ConstrainedMaxPosteriorSampling(
            model=models[0], constraint_model=ModelListGP(*models[1:]), replacement=False
        )
        with torch.no_grad():
            return np.asarray(sampling(torch.from_numpy(candidates), num_samples=batch).numpy())


def _fitted(x: FloatArray, outcome: FloatArray) -> Any:
    """The tutorial's model of one outcome."""
    import torch
    from botorch.fit import fit_gpytorch_mll
    from botorch.models import SingleTaskGP
    from botorch.models.transforms.outcome import Standardize
    from gpytorch.constraints import Interval
    from gpytorch.kernels import MaternKernel, ScaleKernel
    from gpytorch.likelihoods import GaussianLikelihood
    from gpytorch.mlls import ExactMarginalLogLikelihood

    limits = Interval(0.005, 4.0)
    model = SingleTaskGP(
        torch.from_numpy(x),
        torch.from_numpy(outcome)[:, None].clone(),
        covar_module=ScaleKernel(
            MaternKernel(nu=2.5, ard_num_dims=x.shape[1], lengthscale_constraint=limits)
        ),
        likelihood=GaussianLikelihood(noise_constraint=Interval(1e-8, 1e-3)),
        outcome_transform=Standardize(m=1),
    )
    fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model))
    return model
