"""Augmented random search over linear policies (Mania, Guy and Recht, NeurIPS 2018, arXiv:1803.07055).

Algorithm 2 (ARS V2-t) as far as ask and tell reach: the policy's observations are normalised by its problem.
A step is the mean difference of return between both sides of random directions, the better directions alone,
in units of the deviation of these returns:

    M <- M + alpha / (b sigma_R) sum over the best b directions of (r(M + nu d) - r(M - nu d)) d

Safety is not known to it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.settings import CentreSettings
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray


class ArsSettings(CentreSettings):
    """Settings of `ars`.

    Attributes:
        noise: nu, standard deviation of the directions per dimension, in widths of the box.
        step: alpha, length of a step in standard deviations of the directions' noise.
        best: b, share of the directions that a step is made of; at least one is.
    """

    noise: float = Field(default=0.01, gt=0)
    step: float = Field(default=0.02, gt=0)
    best: float = Field(default=0.5, gt=0, le=1)


class Ars(Optimizer[ArsSettings]):
    """Half a batch are directions, the other half their opposites.

    The search starts from the best safe trial. The last direction of an odd batch has no opposite and decides
    nothing, so asked for single trials the search stays where it is. A direction of which a side failed is
    left out.
    """

    name = "ars"
    Settings = ArsSettings

    def prepare(self) -> None:
        """No policy before the first round."""
        self._policy: FloatArray | None = None

    def propose(self, n: int) -> Proposal:
        """The present policy plus and minus random directions."""
        policy, half = self._present(), n // 2
        directions = self.settings.noise * self.rng.standard_normal((n - half, len(policy)))
        paired, single = directions[:half], directions[half:]
        points = np.concatenate([policy + paired, policy - paired, policy + single])
        return Proposal(points=np.clip(points, 0.0, 1.0))

    def finish_round(self, trials: Trials) -> None:
        """One step along the better directions."""
        half = len(trials) // 2
        up, down = trials[:half], trials[half : 2 * half]
        both = np.flatnonzero(up.completed & down.completed)
        if len(both) == 0:
            return
        best = np.maximum(up.objective[both], down.objective[both])
        count = max(1, round(self.settings.best * half))
        chosen = both[np.argsort(-best, kind="stable")[:count]]
        rewards = np.concatenate([up.objective[chosen], down.objective[chosen]])
        deviation = rewards.std()
        if deviation == 0:
            return
        steps = self.space.to_unit(up.z[chosen]) - self.space.to_unit(down.z[chosen])
        gain = (up.objective[chosen] - down.objective[chosen]) / deviation
        gradient = gain @ steps / (2 * self.settings.noise * len(chosen))
        self._policy = np.clip(self._present() + self.settings.step * gradient, 0.0, 1.0)

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """The present policy."""
        return {}, {} if self._policy is None else {"policy": self._policy}

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take back what `method_state` gave."""
        self._policy = arrays.get("policy")

    def _present(self) -> FloatArray:
        """(d,) M in the unit cube; at first the best safe trial."""
        if self._policy is None:
            code = self.trials.z[[self.centre_row()]]
            self._policy = np.clip(self.space.to_unit(code)[0], 0.0, 1.0)
        return self._policy
