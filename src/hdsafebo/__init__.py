"""Safe Bayesian optimisation for the control of high-dimensional embodied systems.

One's own system, with names and units (`examples/` has whole ones):

    System, Real, Integer, Choice, Fixed, Objective, Limit, Linear   describe it
    Study                                                            ask, tell, observe, predict, best
    plots                                                            figures of a study

Arrays in, arrays out:

    FunctionProblem, Problem, Safety, Evaluation   what is optimised
    HdSafeBOLocal, HdSafeBO, make_optimizer        methods: ask, tell, observe, save, load
    Trials, Status                                 tables of trials
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from hdsafebo import plots
    from hdsafebo.optimizers.hdsafebo import HdSafeBO
    from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
    from hdsafebo.optimizers.registry import make_optimizer
    from hdsafebo.problem import FunctionProblem, Problem, Safety
    from hdsafebo.system.constraints import Linear
    from hdsafebo.system.description import System
    from hdsafebo.system.outcomes import Limit, Objective
    from hdsafebo.system.parameters import Choice, Fixed, Integer, Real
    from hdsafebo.system.study import Study
    from hdsafebo.trials import Evaluation, Status, Trials

__all__ = [
    "Choice",
    "Evaluation",
    "Fixed",
    "FunctionProblem",
    "HdSafeBO",
    "HdSafeBOLocal",
    "Integer",
    "Limit",
    "Linear",
    "Objective",
    "Problem",
    "Real",
    "Safety",
    "Status",
    "Study",
    "System",
    "Trials",
    "make_optimizer",
    "plots",
]

_MODULES = {
    "HdSafeBO": "hdsafebo.optimizers.hdsafebo",
    "HdSafeBOLocal": "hdsafebo.optimizers.local.optimizer",
    "make_optimizer": "hdsafebo.optimizers.registry",
    "Linear": "hdsafebo.system.constraints",
    "System": "hdsafebo.system.description",
    "Study": "hdsafebo.system.study",
}
_MODULES |= dict.fromkeys(("FunctionProblem", "Problem", "Safety"), "hdsafebo.problem")
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
