"""LineBO: safe optimisation on one random line at a time."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from hdsafebo.gp.sampling import thompson_sample
from hdsafebo.optimizers.base import Optimizer, Proposal
from hdsafebo.optimizers.core.empty_set import complete_batch
from hdsafebo.optimizers.settings import SafeSetSettings
from hdsafebo.typing import FloatArray


class LineBOSettings(SafeSetSettings):
    """Settings of `linebo`.

    Attributes:
        beta: of the safe set mu + beta * sigma >= h. 2 is what the paper sets for this baseline; SafeLineBO's
            own set is of a lower bound, beta < 0 (`linebo_lower` in the registry).
        candidates: points of the line.
    """

    beta: float = 2.0
    candidates: int = Field(default=500, ge=1)


class LineBO(Optimizer[LineBOSettings]):
    """Random-line Bayesian optimisation (Kirschner, Mutny, Hiller, Ischebeck and Krause, ICML 2019).

    Their algorithm 1 with the random oracle; each one-dimensional problem is one round. Its safe set is
    SafeLineBO's, the points whose confidence bound meets the threshold; as in the paper, Thompson sampling
    chooses among them.

        1  x* <- best safe point
        2  v <- uniform on the sphere
        3  L <- {x* + t v} within the box
        4  S <- {x in L : mu_g(x) + beta sigma_g(x) >= h}
        5  maximise posterior samples of f over S
    """

    name = "linebo"
    holds_contexts = True
    Settings = LineBOSettings

    def propose(self, n: int) -> Proposal:
        """n points of one line."""
        centre = np.clip(self.space.to_unit(self.trials.z[[self.centre_row()]])[0], 0.0, 1.0)
        line = self.space.pinned(self._line(centre, max(self.settings.candidates, n)))
        inputs = self.inputs_at(line)
        safe = self.surrogate.believed_safe(inputs, self.confidence)
        chosen = np.flatnonzero(safe)
        if len(chosen) > n:
            chosen = chosen[thompson_sample(self.surrogate.objective, inputs[chosen], n, self.rng)]
        chosen = complete_batch(chosen, n, inputs, self.surrogate, self.settings.empty_safe_set)
        return Proposal(line[chosen], marked_unsafe=~safe[chosen])

    def _line(self, centre: FloatArray, count: int) -> FloatArray:
        """(count, d) equally spaced points of a random line through the centre, from face to face."""
        direction = self.rng.standard_normal(len(centre))
        # From a point on a face almost every line leaves the cube at once: turn it inwards.
        direction = np.where(centre <= 0.0, np.abs(direction), direction)
        direction = np.where(centre >= 1.0, -np.abs(direction), direction)
        direction /= np.linalg.norm(direction)
        to_faces = np.stack([-centre, 1.0 - centre]) / direction
        reach = to_faces.max(axis=0).min()
        back = to_faces.min(axis=0).max()
        return np.clip(centre + np.linspace(back, reach, count)[:, None] * direction, 0.0, 1.0)
