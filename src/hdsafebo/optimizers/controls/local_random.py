"""Control without a model: Gaussian steps around the best safe point."""

from __future__ import annotations

import numpy as np

from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.settings import CentreSettings

_STEPS = (0.003, 0.3)
"""Smallest and largest standard deviation of a step, per dimension, in widths of the box: two
decades, so that no problem needs a step size of its own."""


class LocalRandom(Optimizer[CentreSettings]):
    """x* + s * normal, x* the best safe point known, s drawn log-uniformly for every trial.

    The range of s spares the control a step size tuned to the problem; whatever scale suits it, a
    part of every batch has it. Without a safe point x* is the point of least violation.
    """

    name = "local_random"
    Settings = CentreSettings
    uses = frozenset({"latent_space", "safety"})  # of the safety functions, which trials were safe

    def propose(self, n: int) -> Proposal:
        """n steps, cut at the box."""
        centre = self.space.to_unit(self.trials.z[[self.centre_row()]])
        low, high = np.log(_STEPS)
        steps = np.exp(self.rng.uniform(low, high, (n, 1)))
        points = centre + steps * self.rng.standard_normal((n, self.space.dimension))
        return Proposal(points=np.clip(points, 0.0, 1.0))
