"""Control without a model: Gaussian steps around the best safe point."""

from __future__ import annotations

import numpy as np
from pydantic import Field, model_validator

from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.settings import CentreSettings


class LocalRandomSettings(CentreSettings):
    """Settings of `local_random`.

    Attributes:
        smallest_step: smallest standard deviation of a step, per dimension, in widths of the box.
        largest_step: largest one.
    """

    smallest_step: float = Field(default=0.003, gt=0)
    largest_step: float = Field(default=0.3, gt=0)

    @model_validator(mode="after")
    def _ordered(self) -> LocalRandomSettings:
        if self.smallest_step > self.largest_step:
            raise ValueError(
                f"smallest_step ({self.smallest_step}) exceeds largest_step ({self.largest_step})"
            )
        return self


class LocalRandom(Optimizer[LocalRandomSettings]):
    """x* + s * normal, x* the best safe point known, s drawn log-uniformly for every trial.

    The range of s spares the control a step size tuned to the problem; whatever scale suits it, a
    part of every batch has it. Without a safe point x* is the point of least violation.
    """

    name = "local_random"
    Settings = LocalRandomSettings
    uses = frozenset({"latent_space", "safety"})  # of the safety functions, which trials were safe

    def propose(self, n: int) -> Proposal:
        """n steps, cut at the box."""
        centre = self.space.to_unit(self.trials.z[[self.centre_row()]])
        low, high = np.log([self.settings.smallest_step, self.settings.largest_step])
        steps = np.exp(self.rng.uniform(low, high, (n, 1)))
        points = centre + steps * self.rng.standard_normal((n, self.space.dimension))
        return Proposal(points=np.clip(points, 0.0, 1.0))
