"""Safe Bayesian optimisation for the control of high-dimensional embodied systems.

One's own system, with names and units (`examples/` has whole ones):

    System, Real, Integer, Choice, Fixed, Objective, Limit, Linear   describe it
    Study                                                            ask, tell, observe, predict, best
    plots                                                            figures of a study

Arrays in, arrays out:

    FunctionProblem, Problem, Safety, Evaluation   what is optimised
    HdSafeBOLocal, HdSafeBO, make_optimizer        methods: ask, tell, observe, save, load
    Optimizer, load_optimizer                      any method, and one that was saved
    Trials, Status                                 tables of trials

Trials with a person in the loop:

    create_session, Session                        see `hdsafebo session --help`

What is raised on purpose is a `HdSafeBOError`: `NoSafePointError`, `ParamsError`, `ProblemError`,
`StateFileError`, `SurrogateError`, `TrialError`, `UnknownNameError`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from hdsafebo.environments import register_with_gymnasium

__version__ = "0.2.0"

if TYPE_CHECKING:
    from hdsafebo import plots
    from hdsafebo.errors import (
        HdSafeBOError,
        NoSafePointError,
        OptimisticWarning,
        ParamsError,
        ProblemError,
        StateFileError,
        SurrogateError,
        TrialError,
        UnknownNameError,
    )
    from hdsafebo.optimizers.base import Optimizer
    from hdsafebo.optimizers.hdsafebo import HdSafeBO
    from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
    from hdsafebo.optimizers.registry import load_optimizer, make_optimizer
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
    from hdsafebo.session.create import create_session
    from hdsafebo.session.session import Session
    from hdsafebo.system.constraints import Linear
    from hdsafebo.system.description import System
    from hdsafebo.system.outcomes import Limit, Objective
    from hdsafebo.system.parameters import Choice, Fixed, Integer, Real
    from hdsafebo.system.study import Study
    from hdsafebo.trials import Evaluation, Status, Trials

__all__ = [
    "AffinePolicy",
    "Choice",
    "EpisodeSafety",
    "Evaluation",
    "Fixed",
    "FunctionProblem",
    "GymnasiumPolicies",
    "HdSafeBO",
    "HdSafeBOError",
    "HdSafeBOLocal",
    "Integer",
    "Limit",
    "Linear",
    "LinearFeatures",
    "NoSafePointError",
    "Objective",
    "OptimisticWarning",
    "Optimizer",
    "ParamsError",
    "Problem",
    "ProblemError",
    "Real",
    "Safety",
    "Session",
    "StateFileError",
    "Status",
    "Study",
    "SurrogateError",
    "System",
    "TrialError",
    "Trials",
    "UnknownNameError",
    "budget",
    "create_session",
    "gaussian_design",
    "lasts",
    "load_optimizer",
    "make_optimizer",
    "plots",
    "survives",
]

_MODULES = {
    "HdSafeBO": "hdsafebo.optimizers.hdsafebo",
    "HdSafeBOLocal": "hdsafebo.optimizers.local.optimizer",
    "Optimizer": "hdsafebo.optimizers.base",
    "Session": "hdsafebo.session.session",
    "create_session": "hdsafebo.session.create",
    "Linear": "hdsafebo.system.constraints",
    "System": "hdsafebo.system.description",
    "Study": "hdsafebo.system.study",
}
_MODULES |= dict.fromkeys(("load_optimizer", "make_optimizer"), "hdsafebo.optimizers.registry")
_MODULES |= dict.fromkeys(
    (name for name in __all__ if name.endswith(("Error", "Warning"))), "hdsafebo.errors"
)
_MODULES |= dict.fromkeys(("FunctionProblem", "LinearFeatures", "Problem", "Safety"), "hdsafebo.problem")
_MODULES |= dict.fromkeys(
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
_MODULES |= dict.fromkeys(("Evaluation", "Status", "Trials"), "hdsafebo.trials")
_MODULES |= dict.fromkeys(("Limit", "Objective"), "hdsafebo.system.outcomes")
_MODULES |= dict.fromkeys(("Choice", "Fixed", "Integer", "Real"), "hdsafebo.system.parameters")


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used, so that importing the package stays quick."""
    if name == "plots":
        return import_module("hdsafebo.plots")
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    """The public names, loaded or not."""
    return sorted({*globals(), *__all__})


register_with_gymnasium()
