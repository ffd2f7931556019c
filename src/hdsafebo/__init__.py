"""Safe Bayesian optimisation for the control of high-dimensional embodied systems."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from hdsafebo.environments import register_with_gymnasium

__version__ = "0.1.0"

if TYPE_CHECKING:
    from hdsafebo.optimizers.hdsafebo import HdSafeBO
    from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
    from hdsafebo.optimizers.registry import make_optimizer
    from hdsafebo.policies import (
        AffinePolicy,
        EpisodeSafety,
        GymnasiumPolicies,
        budget,
        gaussian_design,
        lasts,
        survives,
    )
    from hdsafebo.problem import FunctionProblem, LinearFeatures, Problem, Safety
    from hdsafebo.trials import Evaluation, Status, Trials

__all__ = [
    "AffinePolicy",
    "EpisodeSafety",
    "Evaluation",
    "FunctionProblem",
    "GymnasiumPolicies",
    "HdSafeBO",
    "HdSafeBOLocal",
    "LinearFeatures",
    "Problem",
    "Safety",
    "Status",
    "Trials",
    "budget",
    "gaussian_design",
    "lasts",
    "make_optimizer",
    "survives",
]

_MODULES = (
    {
        "HdSafeBO": "hdsafebo.optimizers.hdsafebo",
        "HdSafeBOLocal": "hdsafebo.optimizers.local.optimizer",
        "make_optimizer": "hdsafebo.optimizers.registry",
    }
    | dict.fromkeys(("FunctionProblem", "LinearFeatures", "Problem", "Safety"), "hdsafebo.problem")
    | dict.fromkeys(("Evaluation", "Status", "Trials"), "hdsafebo.trials")
    | dict.fromkeys(
        (
            "AffinePolicy",
            "EpisodeSafety",
            "GymnasiumPolicies",
            "budget",
            "gaussian_design",
            "lasts",
            "survives",
        ),
        "hdsafebo.policies",
    )
)


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used, so that importing the package stays quick."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


register_with_gymnasium()
