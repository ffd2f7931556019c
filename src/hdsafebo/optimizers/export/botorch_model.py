"""The fitted surrogate as a BoTorch model, for plots and for acquisition functions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdsafebo.gp.gaussian_process import GaussianProcess
from hdsafebo.gp.surrogate import Beliefs
from hdsafebo.gp.warped_process import WarpedProcess
from hdsafebo.gp.warped_surrogate import WarpedSurrogate
from hdsafebo.search.space import SearchSpace
from hdsafebo.typing import FloatArray

if TYPE_CHECKING:
    from botorch.models import ModelListGP, SingleTaskGP
    from botorch.models.transforms.input import AffineInputTransform

_LEAST_NOISE = 1e-10
"""Noise variance of standardised outcomes that GPyTorch would otherwise round up to 1e-6."""


def to_botorch(surrogate: Beliefs, space: SearchSpace | None) -> ModelListGP:
    """A `ModelListGP` with the surrogate's data and hyper-parameters, and so its posterior.

    Warped processes have their warp as outcome transform; their posteriors have the mean and variance of the
    outcome, and samples of it.

    Args:
        surrogate: the fitted processes: objective, then safety functions.
        space: when given, inputs are codes z instead of kernel inputs.
    """
    from botorch.models import ModelListGP

    if isinstance(surrogate, WarpedSurrogate):
        return ModelListGP(*(_warped(process, space) for process in (surrogate.objective, *surrogate.safety)))
    return ModelListGP(*(_single(gp, space) for gp in (surrogate.objective, *surrogate.safety)))


def _warped(process: WarpedProcess, space: SearchSpace | None) -> SingleTaskGP:
    """One warped process; its inputs lie in the unit cube."""
    import torch
    from botorch.models import SingleTaskGP
    from botorch.settings import validate_input_scaling
    from gpytorch.kernels import MaternKernel, ScaleKernel
    from gpytorch.means import ConstantMean
    from gpytorch.settings import min_fixed_noise

    from hdsafebo.optimizers.export.botorch_warp import WarpedOutcome

    inputs, transform = process.inputs, None
    if space is not None:
        inputs, transform = _in_codes(inputs, space)
    outcomes = torch.from_numpy(process.outcomes.restore(process.values))[:, None]
    noise = torch.full_like(outcomes, process.noise_variance + process.jitter * process.variance)
    with validate_input_scaling(False), min_fixed_noise(double_value=_LEAST_NOISE):
        model = SingleTaskGP(
            torch.from_numpy(inputs),
            outcomes,
            train_Yvar=noise,
            mean_module=ConstantMean(),
            covar_module=ScaleKernel(MaternKernel(nu=2.5, ard_num_dims=inputs.shape[1])),
            outcome_transform=WarpedOutcome(process.outcomes),
            input_transform=transform,
        ).double()
    model.mean_module.constant = process.mean
    model.covar_module.outputscale = process.variance
    model.covar_module.base_kernel.lengthscale = torch.from_numpy(process.length_scales)
    return model.eval()


def _single(gp: GaussianProcess, space: SearchSpace | None) -> SingleTaskGP:
    """One process in the units of its outcomes: the standardisation is in mean, scale and noise."""
    import torch
    from botorch.models import SingleTaskGP
    from botorch.settings import validate_input_scaling
    from gpytorch.kernels import MaternKernel, ScaleKernel
    from gpytorch.means import ConstantMean

    inputs, transform = gp.inputs, None
    if space is not None:
        inputs, transform = _in_codes(inputs, space)
    variance = gp.signal_deviation**2
    outcomes = gp.outcomes.restore(gp.values)
    with validate_input_scaling(False):
        model = SingleTaskGP(
            torch.from_numpy(inputs),
            torch.from_numpy(outcomes[:, None]),
            train_Yvar=torch.from_numpy(variance * gp.noise_ratios[:, None]),
            mean_module=ConstantMean(),
            covar_module=ScaleKernel(MaternKernel(nu=2.5)),
            outcome_transform=None,
            input_transform=transform,
        ).double()
    model.mean_module.constant = gp.outcomes.centre + gp.outcomes.scale * gp.mean
    model.covar_module.outputscale = variance
    model.covar_module.base_kernel.lengthscale = gp.length_scale
    return model.eval()


def _in_codes(inputs: FloatArray, space: SearchSpace) -> tuple[FloatArray, AffineInputTransform]:
    """(n, d) codes of (n, d) kernel inputs, and the transform that a model takes codes with."""
    import torch
    from botorch.models.transforms.input import AffineInputTransform

    unit = space.unit / space.metric
    transform = AffineInputTransform(
        space.dimension, coefficient=torch.from_numpy(unit), offset=torch.from_numpy(space.lower)
    )
    return inputs * unit + space.lower, transform
