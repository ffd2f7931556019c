"""Constrained expected improvement, with the paper's kernel or BoTorch's present default models."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hdsafebo.gp.ard import BOTORCH_DEFAULT, Kernel
from hdsafebo.gp.ard_process import ArdProcess, BelievedPool, WarmStart
from hdsafebo.gp.surrogate import modelled_safety, modelled_thresholds
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.settings import SafeSetSettings
from hdsafebo.search.acquisition import (
    Acquisition,
    log_expected_improvement,
    log_feasibility,
    maximise,
)
from hdsafebo.search.candidates import sobol_points
from hdsafebo.trials import Status
from hdsafebo.typing import FloatArray

if TYPE_CHECKING:
    from botorch.models import ModelListGP

_RAW = 512  # points of the cube that starts are chosen from, as in BoTorch's tutorials
_NEAR = 128
_NEAR_STEP = 0.05  # and as many around the incumbent, at this standard deviation in sides of the cube
_STARTS = 3
_ASCENT = 25  # steps of one point's ascent from each start
_POLISH = 40
"""Most steps of the batch's joint ascent, each as dear as tens of a single point's; BoTorch allows 200."""
_MC_SAMPLES = 64  # of the batch's joint posterior
_SEEDS = 2**31
_Term = Callable[[FloatArray, FloatArray, float], tuple[FloatArray, FloatArray, FloatArray]]
P = TypeVar("P")


class CeiSettings(SafeSetSettings):
    """Settings of `cei` and `cei_prob`.

    Attributes:
        kernel: "matern52" is the paper's kernel for all methods, "rbf" BoTorch's default.
    """

    kernel: Kernel = "matern52"


class CeiProb(Optimizer[CeiSettings]):
    """Expected improvement times probability of feasibility (Schonlau et al. 1998; Gardner et al. 2014).

    In logarithms, log EI + sum_j log Pr(g_j >= h_j), as BoTorch's `LogConstrainedExpectedImprovement`. The
    points of a batch are chosen one after another, each as if the outcomes of those before it, and of those
    under evaluation, were their means. The improvement counts from the best feasible outcome; while there is
    none, only feasibility is maximised.

    The models are those of `botorch.models.SingleTaskGP`: one length scale per dimension with the
    dimension-scaled prior (Hvarfner et al. 2024), standardised outcomes. The kernel is the paper's
    Matern-5/2, or BoTorch's default, the squared exponential (`kernel`). What a trial carries of safety comes
    from the common surrogate, as for all methods: the acquisition function weighs feasibility and demands
    none, so trials that the surrogate does not believe safe are marked, or left out (`empty_safe_set`).
    """

    name = "cei_prob"
    Settings = CeiSettings
    uses = frozenset({"latent_space", "safety"})  # a length scale for each searched coordinate

    def prepare(self) -> None:
        """No fits yet."""
        self._warm = WarmStart()

    def propose(self, n: int) -> Proposal:
        """n greedy maxima."""
        return Proposal(self._greedy_batch(self._processes(), n))

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """The last fits."""
        return {}, self._warm.arrays()

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `method_state` gave."""
        self._warm = WarmStart.of(arrays)

    def _processes(self) -> list[ArdProcess]:
        """Objective first, then the margins of the modelled safety functions over their thresholds."""
        self.centre_row()  # explains what is missing
        trials = self.trials[self.trials.completed]
        x = self.space.to_unit(trials.z)
        margins = modelled_safety(self.problem.safety, trials.safety) - modelled_thresholds(
            self.problem.safety
        )
        named = {"objective": trials.objective} | {f"safety{j}": margin for j, margin in enumerate(margins.T)}
        model = replace(BOTORCH_DEFAULT, kernel=self.settings.kernel)
        return [self._warm.process(name, x, y, model) for name, y in named.items()]

    def _greedy_batch(self, processes: list[ArdProcess], n: int) -> FloatArray:
        """(n, d) points, each given the believed outcomes of those before it."""
        d = self.space.dimension
        feasible = self.best()
        best = None if feasible is None else float(feasible.objective)
        for point in self._waiting():
            processes, best = _believing(processes, point, best)
        centre = np.clip(self.space.to_unit(self.trials.z[[self.centre_row()]]), 0.0, 1.0)
        near = np.clip(centre + _NEAR_STEP * self.rng.standard_normal((_NEAR, d)), 0.0, 1.0)
        raw = np.vstack([sobol_points(_RAW, d, self.rng), near])
        pools = [BelievedPool(process, raw) for process in processes]
        chosen = np.empty((0, d))
        while True:
            value = sum(term(p.mean, p.sd, at)[0] for p, term, at in _terms(pools, best))
            starts = raw[np.argsort(-np.asarray(value), kind="stable")[:_STARTS]]
            acquisition = constrained_improvement(processes, best)
            point, _ = maximise(acquisition, starts, np.zeros(d), np.ones(d), _ASCENT)
            chosen = np.vstack([chosen, point])
            if len(chosen) == n:
                return chosen
            processes, best = _believing(processes, point, best)
            for pool, process in zip(pools, processes, strict=True):
                pool.follow(process)

    def _waiting(self) -> FloatArray:
        """(k, d) points of the unit cube that are under evaluation."""
        return self.space.to_unit(self.trials.z[self.trials.status == Status.PENDING])


class Cei(CeiProb):
    """Constrained expected improvement of the whole batch, through BoTorch.

    BoTorch's `qLogExpectedImprovement` with the safety functions as constraints (Ament et al. 2023): the
    expectation, over joint posterior samples of the batch, of the best feasible improvement. Its
    optimiser starts from the batch that `cei_prob` would take; from one of BoTorch's own random starts it
    ends lower. The `SingleTaskGP`s are used as they come; only their hyper-parameters are fitted here, to
    the same optimum in a fraction of the time.
    """

    name = "cei"

    def propose(self, n: int) -> Proposal:
        """The batch of n points with the largest constrained expected improvement."""
        processes = self._processes()
        greedy = self._greedy_batch(processes, n)
        seed = int(self.rng.integers(_SEEDS))
        return Proposal(_improve_batch(processes, greedy, self._waiting(), self._incumbent(), seed))

    def _incumbent(self) -> float:
        """The best feasible outcome; without one a value below all that was observed, as in BoTorch."""
        best = self.best()
        if best is not None:
            return float(best.objective)
        observed = self.trials.objective[self.trials.completed]
        return float(observed.min() - (observed.max() - observed.min() or 1.0))


def _believing(
    processes: list[ArdProcess], point: FloatArray, best: float | None
) -> tuple[list[ArdProcess], float | None]:
    """The processes and the incumbent as if their means had been observed at a point (d,)."""
    believed, *margins = (float(p.predict(point[None])[0][0]) for p in processes)
    if min(margins) >= 0:
        best = believed if best is None else max(best, believed)
    return [process.believing(point[None]) for process in processes], best


def constrained_improvement(processes: list[ArdProcess], best: float | None) -> Acquisition:
    """Sum of log expected improvement and log probabilities of feasibility, and its gradient.

    Args:
        processes: objective, then margins that are feasible from 0 up.
        best: incumbent; None leaves the improvement out.
    """
    terms = _terms(processes, best)

    def acquisition(q: FloatArray) -> tuple[FloatArray, FloatArray]:
        value, gradient = np.zeros(len(q)), np.zeros_like(q)
        for process, term, reference in terms:
            mean, sd, pullback = process.predict_with_pullback(q)
            part, by_mean, by_sd = term(mean, sd, reference)
            value += part
            gradient += pullback(by_mean, by_sd)
        return value, gradient

    return acquisition


def _terms(posteriors: list[P], best: float | None) -> list[tuple[P, _Term, float]]:
    """For the objective, and for margins that are feasible from 0 up: the logarithm and its reference."""
    objective, *margins = posteriors
    terms: list[tuple[P, _Term, float]] = [(p, log_feasibility, 0.0) for p in margins]
    return terms if best is None else [*terms, (objective, log_expected_improvement, best)]


def default_models(processes: list[ArdProcess]) -> ModelListGP:
    """BoTorch's default models, or those with a Matern-5/2 kernel, with the fitted hyper-parameters."""
    import torch
    from botorch.models import ModelListGP, SingleTaskGP
    from gpytorch.kernels import MaternKernel

    models = []
    for process in processes:
        x, y = torch.from_numpy(process.x), torch.from_numpy(process.y)[:, None]
        kernel = None
        if process.model.kernel == "matern52":
            kernel = MaternKernel(nu=2.5, ard_num_dims=x.shape[1])
        model = SingleTaskGP(x, y, covar_module=kernel).double()
        model.covar_module.lengthscale = torch.from_numpy(process.fit.length_scales)
        model.likelihood.noise = process.fit.noise
        model.mean_module.constant = torch.tensor(process.fit.mean)
        models.append(model.eval())
    return ModelListGP(*models)


def _outcome(j: int, sign: float = 1.0) -> Callable[..., Any]:
    """Of BoTorch's samples the outcome j; its constraints are met below 0, ours from 0 up."""

    def chosen(samples: Any, X: Any = None) -> Any:
        return sign * samples[..., j]

    return chosen


def _improve_batch(
    processes: list[ArdProcess], greedy: FloatArray, pending: FloatArray, best: float, seed: int
) -> FloatArray:
    """(n, d) batch that BoTorch's optimiser makes of the greedy one, beside (k, d) pending points."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import torch
        from botorch.acquisition.logei import qLogExpectedImprovement
        from botorch.acquisition.objective import GenericMCObjective
        from botorch.optim import optimize_acqf
        from botorch.sampling import SobolQMCNormalSampler

        n, d = greedy.shape
        acquisition = qLogExpectedImprovement(
            default_models(processes),
            best_f=best,
            sampler=SobolQMCNormalSampler(torch.Size([_MC_SAMPLES]), seed=seed),
            objective=GenericMCObjective(_outcome(0)),
            constraints=[_outcome(j, -1.0) for j in range(1, len(processes))],
            X_pending=torch.from_numpy(pending) if len(pending) else None,
        )
        box = torch.stack([torch.zeros(d, dtype=torch.double), torch.ones(d, dtype=torch.double)])
        with torch.random.fork_rng():
            torch.manual_seed(seed)
            batch, _ = optimize_acqf(
                acquisition,
                box,
                q=n,
                num_restarts=1,
                batch_initial_conditions=torch.from_numpy(greedy)[None],
                options={"maxiter": _POLISH},
            )
    return np.asarray(batch.numpy())
