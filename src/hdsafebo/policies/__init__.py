"""Safe search over policies of any Gymnasium environment.

`GymnasiumPolicies` (in `problem.py`) is the `Problem`; the other modules are its parts: affine policies,
episodes, safety functions of episodes, initial designs, action synergies, behaviour features, playing and
recording. Knows no optimiser and no particular environment.
"""

from hdsafebo.policies.affine import AffinePolicy, Normalisation, PolicySpace
from hdsafebo.policies.designs import gaussian_design
from hdsafebo.policies.episode import Episode
from hdsafebo.policies.problem import GymnasiumPolicies
from hdsafebo.policies.safety import EpisodeSafety, budget, lasts, survives
from hdsafebo.policies.synergies import ActionSynergies

__all__ = [
    "ActionSynergies",
    "AffinePolicy",
    "Episode",
    "EpisodeSafety",
    "GymnasiumPolicies",
    "Normalisation",
    "PolicySpace",
    "budget",
    "gaussian_design",
    "lasts",
    "survives",
]
