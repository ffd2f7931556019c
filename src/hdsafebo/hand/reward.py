"""The reward of one control step (paper, appendix: musculoskeletal model control), term by term.

r = r_pose + r_bonus - 10 r_penalty + r_grasp + 2 r_survive - r_activation - 100 r_drop

The paper names the terms; their scales below were chosen so that random policies return what the paper's
initial policies do (-800 to -200 over 120 steps).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

# What the paper's formula leaves open; the report lists it among the departures.
POSE_WEIGHT = 3.5  # per rad of tilt
BONUS_WEIGHT = 2.0
BONUS_TILTS = (0.35, 0.15)  # rad; the bonus is given for each that is undercut
GRASP_WEIGHT = 5.0  # per m between palm and bottle
MAX_DISPLACEMENT = 0.2  # m of the bottle from its start


@dataclass(frozen=True)
class Reward:
    """The terms, before the weights that the paper's formula gives them.

    Attributes:
        pose: -3.5 times the tilt (rad). While the bottle is in the place of the forearm, which it does not
            touch, the tilt counts as 90 degrees or more.
        bonus: 2 for a tilt below 0.35 rad and 2 more below 0.15 rad.
        penalty: 1 when the bottle is more than 0.2 m from where it started.
        grasp: -5 times the distance of bottle and palm (m).
        survive: 1 unless the bottle dropped in this step.
        activation: mean squared activation.
        drop: 1 when the bottle dropped in this step.
    """

    pose: float
    bonus: float
    penalty: float
    grasp: float
    survive: float
    activation: float
    drop: float

    @property
    def total(self) -> float:
        """The reward r."""
        return (
            self.pose
            + self.bonus
            - 10 * self.penalty
            + self.grasp
            + 2 * self.survive
            - self.activation
            - 100 * self.drop
        )

    @classmethod
    def of(
        cls,
        *,
        tilt: float,
        in_forearm: bool,
        displacement: float,
        palm_distance: float,
        mean_square_activation: float,
        dropped: bool,
    ) -> Reward:
        """The terms of a step; angles in rad, distances in m."""
        credited = max(tilt, np.pi / 2) if in_forearm else tilt
        return cls(
            pose=-POSE_WEIGHT * credited,
            bonus=BONUS_WEIGHT * sum(credited < limit for limit in BONUS_TILTS),
            penalty=float(displacement > MAX_DISPLACEMENT),
            grasp=-GRASP_WEIGHT * palm_distance,
            survive=float(not dropped),
            activation=mean_square_activation,
            drop=float(dropped),
        )

    def as_dict(self) -> dict[str, float]:
        """The terms by name, as the environment logs them."""
        return {f.name: getattr(self, f.name) for f in fields(self)}
