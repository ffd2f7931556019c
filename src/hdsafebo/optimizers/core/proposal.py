"""From where a method wants its next trials to the points that will really be evaluated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdsafebo.errors import ProblemError, TrialError
from hdsafebo.problem import Codec, MovingCodec, Problem, decoded, encoded
from hdsafebo.search.space import SearchSpace
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray, IntArray

_ROUNDING = 1e-12
"""In widths of the searched box: what an encoder that undoes its decoder may miss a code by."""


@dataclass(frozen=True)
class Proposal:
    """Where a method wants the next trials: k of them, at least one and at most as many as it was asked for.

    Attributes:
        points: (k, d) in the unit cube; None when `rows` are given.
        rows: (k,) rows of the problem's finite candidate set, when the method chose among them itself.
        trust_region_length: of the region the points come from, a number or (k,); NaN without one.
        marked_unsafe: (k,) True for points that are not believed safe; None means that all are.
    """

    points: FloatArray | None = None
    rows: IntArray | None = None
    trust_region_length: float | FloatArray = np.nan
    marked_unsafe: NDArray[np.bool_] | None = None


def realise(
    proposal: Proposal,
    problem: Problem,
    embedding: Codec | None,
    space: SearchSpace,
    *,
    taken: IntArray,
    first_id: int,
    round: int,
) -> Trials:
    """The trials of a proposal: decoded; on a finite set, moved to the nearest free candidates.

    Args:
        proposal: of a method.
        problem: whose bounds or candidates limit the inputs.
        embedding: from codes to inputs; None when the inputs themselves are searched.
        space: the searched box.
        taken: candidate rows that must not be proposed again.
        first_id: id of the first trial.
        round: of all of them.

    Raises:
        ProblemError: the method chose rows of a candidate set that the problem does not have.
        TrialError: the embedding gave codes of another shape, or not finite.
    """
    x, codes, rows = _located(proposal, problem, embedding, space, taken)
    n = len(x)
    marked = np.zeros(n, bool) if proposal.marked_unsafe is None else np.asarray(proposal.marked_unsafe, bool)
    return Trials.pending(
        x,
        codes,
        len(problem.safety),
        first_id=first_id,
        round=round,
        candidate=np.asarray(rows, np.int64),
        trust_region_length=np.broadcast_to(np.asarray(proposal.trust_region_length, float), (n,)).copy(),
        marked_unsafe=marked,
    )


def _located(
    proposal: Proposal, problem: Problem, embedding: Codec | None, space: SearchSpace, taken: IntArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Inputs (k, D), codes (k, d) and candidate rows (k,), -1 without a candidate set."""
    candidates = problem.candidates
    if proposal.rows is not None:
        if candidates is None:
            raise ProblemError(f"rows were proposed, but {problem.name!r} has no candidate set")
        x = candidates.inputs(proposal.rows)
        return x, encode(embedding, x), proposal.rows
    assert proposal.points is not None, "a proposal has points or rows"
    z = space.to_code(space.pinned(proposal.points))
    x = z if embedding is None else decoded(embedding, z)
    if candidates is not None:
        rows = candidates.nearest(x, taken)
        x = candidates.inputs(rows)
        return x, encode(embedding, x), rows
    x, rows = np.clip(x, problem.bounds[0], problem.bounds[1]), np.full(len(x), -1)
    x = problem.land(x) if problem.lands else x
    if problem.resolution is not None and embedding is None:
        x = np.rint(x / problem.resolution) * problem.resolution
    codes = encode(embedding, x)
    if embedding is not None:
        # An autoencoder's encoder does not undo its decoder, and the outcome is a function of the code that
        # was decoded. Where it does undo it, up to rounding, its code is taken, which `observe` would give
        # the same input. Where the input was moved, it is no image of the code at all, and is encoded.
        encoded = (np.abs(codes - z) <= _ROUNDING * space.unit).all(axis=1)
        if isinstance(embedding, MovingCodec):
            encoded |= embedding.moved(z)
        codes = np.where(encoded[:, None], codes, z)
    return x, codes, rows


def encode(embedding: Codec | None, x: FloatArray, known: ArrayLike | None = None) -> FloatArray:
    """(n, d) codes of (n, D) inputs; the inputs themselves without an embedding.

    Args:
        embedding: from codes to inputs.
        x: the inputs.
        known: (n, d) codes that some were decoded from, NaN in the other rows.

    Raises:
        TrialError: the embedding gave codes of another shape, or not finite; or the known ones have one.
    """
    z = x if embedding is None else encoded(embedding, x)
    if z.ndim != 2 or len(z) != len(x) or not np.isfinite(z).all():
        raise TrialError(
            f"the embedding gave codes of shape {z.shape} for {len(x)} inputs; expected finite (n, d)"
        )
    if known is None:
        return z
    given = np.asarray(known, float)
    if given.shape != z.shape:
        raise TrialError(f"codes have shape {given.shape}; expected {z.shape}")
    return np.where(np.isfinite(given).all(axis=1, keepdims=True), given, z)


def candidates_left(problem: Problem, taken: IntArray) -> int:
    """How many more points a problem can be asked for, given the candidate rows that are taken."""
    if problem.candidates is None:
        return int(np.iinfo(np.int64).max)
    return len(problem.candidates) - len(taken)
