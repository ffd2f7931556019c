"""Columns of the input that are known before a trial and not chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from hdsafebo.errors import ProblemError, TrialError
from hdsafebo.optimizers.core.results import check_points
from hdsafebo.problem import Codec, ContextualSet, Problem
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray

_REACHED = 15
"""Trials at least as far out after which a context counts as known."""
_NOVEL = 6.0
"""By how much beta is lower under contexts that no trial has reached. What a context does is not known before
two of them were tried: the model takes it for as little as the settings do, and was wrong by four to six of
its own standard deviations on the list of `benchmarks/own_system.py`. Chosen there on seeds 0 to 7: with 4
and ten trials 5 of 236 trials on days heavier than any before were unsafe, with 6 and fifteen 0 of 234."""


def novel_beta(beta: float, trials: Trials, columns: Sequence[int], context: FloatArray) -> float:
    """Beta, lowered under a context that few completed trials have reached.

    Args:
        beta: as given.
        trials: so far.
        columns: of the contexts.
        context: (c,) their values now.
    """
    if not columns:
        return beta
    known = trials.x[np.ix_(trials.completed, np.asarray(columns))]
    reached = np.minimum((known >= context).sum(axis=0), (known <= context).sum(axis=0)).min()
    return beta - _NOVEL * max(0.0, 1.0 - float(reached) / _REACHED)


def check_able(method: str, holds_contexts: bool, problem: Problem, embedding: Codec | None) -> None:
    """Raise `ProblemError` where a method cannot do what a problem needs."""
    if embedding is not None and (problem.contexts or problem.lands):
        what = "contexts" if problem.contexts else "points that cannot be run"
        raise ProblemError(f"{problem.name!r} has {what}, which cannot be searched through an embedding")
    if not problem.contexts:
        return
    if not holds_contexts:
        raise ProblemError(
            f"method {method!r} would choose the contexts of {problem.name!r}, which are known before a "
            "trial; methods that hold contexts: hdsafebo_local, hdsafebo, linebo"
        )
    if problem.candidates is not None and not isinstance(problem.candidates, ContextualSet):
        raise ProblemError(
            f"the candidates of {problem.name!r} cannot hold its contexts; expected a ContextualSet"
        )


def checked_context(problem: Problem, context: ArrayLike | None) -> FloatArray:
    """(c,) values of the context columns.

    Raises:
        TrialError: they are missing, not as many as there are columns, not finite or out of bounds.
    """
    columns = list(problem.contexts)
    if context is None:
        if not columns:
            return np.empty(0)
        raise TrialError(f"{problem.name!r} has {len(columns)} context columns; pass their values as context")
    values = check_points("context", np.atleast_2d(np.asarray(context)), len(columns))
    if len(values) != 1:
        raise TrialError(f"context has {len(values)} rows; expected one value per context column")
    lower, upper = problem.bounds[:, columns]
    if (values < lower).any() or (values > upper).any():
        raise TrialError(f"context is {values[0].tolist()}; expected {lower.tolist()} to {upper.tolist()}")
    return values[0]


def in_context(problem: Problem, trials: Trials, context: FloatArray) -> Trials:
    """The trials as they would be under the given context; without an embedding codes are inputs."""
    if not problem.contexts:
        return trials
    x = trials.x.copy()
    x[:, list(problem.contexts)] = context
    return replace(trials, x=x, z=x.copy())
