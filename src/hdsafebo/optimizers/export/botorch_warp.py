"""Warped outcomes as an outcome transform of BoTorch."""

from __future__ import annotations

from typing import Any

import torch
from botorch.models.transforms.outcome import OutcomeTransform
from botorch.posteriors import TransformedPosterior
from torch import Tensor

from hdsafebo.gp.warped_fit import Standard


class WarpedOutcome(OutcomeTransform):
    """Outcomes warped and standardised; variances of observations are given standardised.

    Args:
        outcomes: how outcomes become what is modelled.
    """

    def __init__(self, outcomes: Standard) -> None:
        super().__init__()
        self._outcomes = outcomes
        self._finite = bool(outcomes.warp.scale < float("inf"))

    def forward(self, Y: Tensor, Yvar: Tensor | None = None, X: Tensor | None = None) -> Any:
        """What is modelled of outcomes."""
        o = self._outcomes
        t = Y - o.warp.centre
        if self._finite:
            t = torch.asinh(t / o.warp.scale)
        return (t - o.shift) / o.unit, Yvar

    def untransform(self, Y: Tensor, Yvar: Tensor | None = None, X: Tensor | None = None) -> Any:
        """Inverse of `forward`."""
        return self._restore(Y), Yvar

    def untransform_posterior(self, posterior: Any, X: Tensor | None = None) -> TransformedPosterior:
        """Posterior of the outcome."""
        return TransformedPosterior(posterior, self._restore, self._mean, self._variance)

    def _restore(self, t: Tensor) -> Tensor:
        o = self._outcomes
        t = o.shift + o.unit * t
        return o.warp.centre + (o.warp.scale * torch.sinh(t) if self._finite else t)

    def _mean(self, mean: Tensor, variance: Tensor) -> Tensor:
        """Of c + s sinh(t), t Gaussian."""
        if not self._finite:
            return self._restore(mean)
        o = self._outcomes
        spread = torch.exp(0.5 * o.unit**2 * variance)
        return o.warp.centre + o.warp.scale * spread * torch.sinh(o.shift + o.unit * mean)

    def _variance(self, mean: Tensor, variance: Tensor) -> Tensor:
        o = self._outcomes
        v = o.unit**2 * variance
        if not self._finite:
            return v
        twice = 2.0 * (o.shift + o.unit * mean)
        return o.warp.scale**2 * 0.5 * torch.expm1(v) * (torch.exp(v) * torch.cosh(twice) + 1.0)
