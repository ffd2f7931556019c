"""Methods by name. Nothing is imported before a method is made."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdsafebo.errors import UnknownNameError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from hdsafebo.optimizers.base import Optimizer
    from hdsafebo.optimizers.settings import OptimizerSettings
    from hdsafebo.problem import Codec, Problem


@dataclass(frozen=True)
class Method:
    """Where a method is defined, and the settings that its name stands for.

    Attributes:
        module: module within `hdsafebo.optimizers`.
        kind: class.
        settings: fixed settings.
    """

    module: str
    kind: str
    settings: dict[str, Any] = field(default_factory=dict)


METHODS: dict[str, Method] = {
    "hdsafebo": Method("hdsafebo", "HdSafeBO"),
    # other readings of the paper: Algorithms 1 and 2 exactly as they are listed, and l_t in length scales
    "hdsafebo_printed": Method(
        "hdsafebo", "HdSafeBO", {"box": "half_width", "batch_success": "improved", "perturbed": None}
    ),
    "hdsafebo_length_scales": Method("hdsafebo", "HdSafeBO", {"unit": "length_scale", "perturbed": None}),
    "hdsafebo_local": Method("local.optimizer", "HdSafeBOLocal"),
    # ablations of the paper (figures of its appendix): no local search, no optimism, other confidence
    "hdsafebo_global": Method("hdsafebo", "HdSafeBO", {"local": False}),
    "hdsafebo_pessimistic": Method("hdsafebo", "HdSafeBO", {"beta": -2.0}),
    "hdsafebo_beta0": Method("hdsafebo", "HdSafeBO", {"beta": 0.0}),
    "hdsafebo_beta4": Method("hdsafebo", "HdSafeBO", {"beta": 4.0}),
    "hdsafebo_beta8": Method("hdsafebo", "HdSafeBO", {"beta": 8.0}),
    "hdsafebo_beta16": Method("hdsafebo", "HdSafeBO", {"beta": 16.0}),
    # baselines as the paper has them, each followed by its variants: the usual lower bound in place of the
    # paper's upper one, BoTorch's default kernel in place of the paper's, a step chosen on other seeds
    "linebo": Method("baselines.linebo", "LineBO"),
    "linebo_lower": Method("baselines.linebo", "LineBO", {"beta": -2.0}),
    "scbo": Method("baselines.scbo", "Scbo"),
    "config": Method("baselines.config", "Config"),
    "cei": Method("baselines.cei", "Cei"),
    "cei_botorch": Method("baselines.cei", "Cei", {"kernel": "rbf"}),
    "cei_prob": Method("baselines.cei", "CeiProb"),
    "cei_prob_botorch": Method("baselines.cei", "CeiProb", {"kernel": "rbf"}),
    "cmaes": Method("baselines.cmaes", "CmaEs"),
    "cmaes_tuned": Method("baselines.cmaes", "CmaEs"),
    "cmaes_centre": Method("baselines.cmaes", "CmaEs", {"start": "centre"}),
    "safeopt": Method("baselines.safeopt", "SafeOpt"),
    # without regard to safety
    "turbo": Method("baselines.turbo", "Turbo"),
    "hesbo": Method("baselines.hesbo", "Hesbo"),
    "baxus": Method("baselines.baxus", "Baxus"),
    "ars": Method("baselines.ars", "Ars"),
    # controls: the model without a search around the best trial, and no model
    "thompson_rows": Method("controls.thompson_rows", "ThompsonRows"),
    "sobol": Method("controls.sobol", "Sobol"),
    "local_random": Method("controls.local_random", "LocalRandom"),
    "random_lowest": Method("controls.random_lowest", "RandomLowest"),
}


def method_names() -> list[str]:
    """All valid names."""
    return list(METHODS)


def method_module(name: str) -> str:
    """The module that defines a method; see `method_class`."""
    return f"hdsafebo.optimizers.{_method(name).module}"


def method_class(name: str) -> tuple[type[Optimizer], dict[str, Any]]:
    """The class behind a name, and the settings that the name stands for.

    Raises:
        UnknownNameError: there is no such method; the message lists the names.
    """
    method = _method(name)
    return getattr(import_module(method_module(name)), method.kind), method.settings


def _method(name: str) -> Method:
    if name not in METHODS:
        raise UnknownNameError("method", name, list(METHODS))
    return METHODS[name]


def make_optimizer(
    name: str,
    problem: Problem,
    *,
    embedding: Codec | None = None,
    seed: int = 0,
    bounds: ArrayLike | None = None,
    settings: OptimizerSettings | None = None,
    **keywords: Any,
) -> Optimizer:
    """Make an optimiser by the name of its method.

    Args:
        name: name of the method.
        problem: what is optimised.
        embedding: see `Optimizer`.
        seed: see `Optimizer`.
        bounds: see `Optimizer`.
        settings: settings beyond, or instead of, those that the name stands for; None takes the keywords.
        keywords: the same by name.

    Raises:
        UnknownNameError: there is no such method.
        ProblemError: the problem or the box is ill-posed.
        ParamsError: a setting is unknown, of the wrong type or out of range.
    """
    kind, fixed = method_class(name)
    if settings is not None:
        from hdsafebo.optimizers.settings import check_settings

        check_settings(kind.Settings, name, settings, keywords)
        keywords = settings.model_dump(exclude_unset=True)
    return kind(problem, embedding=embedding, seed=seed, bounds=bounds, **(fixed | keywords))


def load_optimizer(
    name: str, path: str | Path, problem: Problem, embedding: Codec | None = None
) -> Optimizer:
    """Load an optimiser by the name of its method; see `Optimizer.load`."""
    kind, _ = method_class(name)
    return kind.load(path, problem, embedding)
