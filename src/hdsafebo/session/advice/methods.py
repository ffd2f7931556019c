"""The optimisers of sessions by name: those of `hdsafebo.optimizers`, and one of the sessions' own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdsafebo.optimizers.registry import load_optimizer, make_optimizer, method_class

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from hdsafebo.optimizers.base import Optimizer
    from hdsafebo.problem import Codec, Problem

SHORTLIST = "hdsafebo_shortlist"


def session_method(name: str) -> tuple[type[Optimizer], dict[str, Any]]:
    """The class behind a name, and the settings that the name stands for.

    Raises:
        UnknownNameError: there is no such method.
    """
    if name == SHORTLIST:
        from hdsafebo.session.advice.shortlist import HdSafeBOShortlist

        return HdSafeBOShortlist, {}
    return method_class(name)


def make_method(
    name: str,
    problem: Problem,
    *,
    embedding: Codec | None,
    bounds: ArrayLike | None,
    seed: int,
    **settings: Any,
) -> Optimizer:
    """Make an optimiser; see `registry.make_optimizer`."""
    if name != SHORTLIST:
        return make_optimizer(name, problem, embedding=embedding, bounds=bounds, seed=seed, **settings)
    kind, _ = session_method(name)
    return kind(problem, embedding=embedding, bounds=bounds, seed=seed, **settings)


def load_method(name: str, path: Path, problem: Problem, embedding: Codec | None) -> Optimizer:
    """Load an optimiser; see `Optimizer.load`."""
    if name != SHORTLIST:
        return load_optimizer(name, path, problem, embedding)
    return session_method(name)[0].load(path, problem, embedding)
