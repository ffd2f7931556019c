"""What tells that a saved state belongs to the problem and the embedding that it is loaded with.

Names and numbers must be equal. Functions cannot be saved, so what they made of some points is: codes of the
embedding, features, transforms. Such values may differ by what another computer, or another number of
threads, makes of the same calculation, so they are compared up to that.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import StateFileError
from hdsafebo.gp.surrogate import modelled_safety, modelled_thresholds
from hdsafebo.optimizers.core.results import same_points
from hdsafebo.problem import CandidateSet, Codec, Problem, decoded, encoded, features_of
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import FloatArray

_CHECKED = 8
"""Trials whose codes, features and transforms are compared; each may cost a pass of a network."""
_BLOCKS = 4096
_EQUAL = 1e-9
"""Least relative difference of two fingerprints of candidates that counts."""


def identity_of(problem: Problem) -> dict[str, Any]:
    """Names and numbers of a problem, as plain data."""
    safety = [[s.name, s.threshold, s.modelled, s.transform is not None] for s in problem.safety]
    candidates = None if problem.candidates is None else len(problem.candidates)
    numbers = {"name": problem.name, "safety": safety, "candidates": candidates}
    description = getattr(problem, "description", None)
    return numbers if description is None else numbers | {"description": description}


def evidence_of(problem: Problem, trials: Trials) -> dict[str, NDArray[Any]]:
    """What functions of a problem make of its candidates and of the first trials; and its bounds."""
    evidence = {"bounds": np.asarray(problem.bounds, float)}
    if problem.candidates is not None:
        evidence["candidates"] = fingerprint(problem.candidates)
    some = trials[:_CHECKED]
    if problem.features is not None:
        evidence["features"] = features_of(problem, some.x)
    told = some.safety[some.status == Status.COMPLETED]
    evidence["transformed"] = np.vstack(
        [modelled_thresholds(problem.safety)[None], modelled_safety(problem.safety, told)]
    )
    return evidence


def check_identity(path: Path, saved: dict[str, Any], problem: Problem) -> None:
    """Refuse the state of another problem.

    Raises:
        StateFileError: names what differs.
    """
    for key, value in identity_of(problem).items():
        if key == "description" and key not in saved:
            continue  # a state that was saved before problems had one
        if saved.get(key) != value:
            raise StateFileError(f"{path}: {key} of the problem was {saved.get(key)!r}; expected {value!r}")


def check_bounds(path: Path, saved: dict[str, NDArray[Any]], problem: Problem) -> None:
    """Refuse a problem over another box.

    Raises:
        StateFileError: the bounds differ.
    """
    if not np.array_equal(saved["bounds"], problem.bounds):
        raise StateFileError(f"{path}: bounds of problem {problem.name!r} differ from those that were saved")


def check_evidence(path: Path, saved: dict[str, NDArray[Any]], problem: Problem, trials: Trials) -> None:
    """Refuse a problem whose functions or candidates give other values than the saved ones.

    Raises:
        StateFileError: names what differs.
    """
    present = evidence_of(problem, trials)
    if problem.candidates is not None:
        same = np.isclose(saved["candidates"], present["candidates"], rtol=0.0, atol=_EQUAL)
        if not same.all():
            total = len(problem.candidates)
            first = int(np.flatnonzero(~same)[0]) * _rows_per_block(total)
            raise StateFileError(
                f"{path}: the candidates of problem {problem.name!r} are not those that were saved; "
                f"they differ from row {first} or soon after"
            )
        rows = np.flatnonzero(trials.candidate >= 0)
        if len(rows):
            # Contexts are those of each trial, and the set gives those of the day.
            chosen = np.setdiff1d(np.arange(trials.x.shape[1]), problem.contexts)
            inputs = problem.candidates.inputs(trials.candidate[rows])
            if not same_points(trials.x[rows][:, chosen], inputs[:, chosen]).all():
                raise StateFileError(f"{path}: trials are not the inputs of their candidate rows")
    for key, what in (("features", "features"), ("transformed", "transforms of safety functions")):
        ours, theirs = saved.get(key), present.get(key)
        if (ours is None) != (theirs is None):
            raise StateFileError(f"{path}: saved {'with' if theirs is None else 'without'} {what}")
        if ours is not None and theirs is not None and not same_points(ours, theirs).all():
            raise StateFileError(f"{path}: {what} of problem {problem.name!r} give other values than before")


def check_codes(path: Path, trials: Trials, problem: Problem, embedding: Codec | None) -> None:
    """Refuse another embedding than the one the codes were made with.

    Raises:
        StateFileError: it gives other codes.
    """
    if len(trials) and not _belong(trials[:_CHECKED], problem, embedding).all():
        raise StateFileError(f"{path}: the embedding gives other codes than those that were saved")


def _belong(trials: Trials, problem: Problem, embedding: Codec | None) -> NDArray[np.bool_]:
    """(n,) True where the code is the input's, or the input is the code's (see `proposal.realise`)."""
    if embedding is None:
        return same_points(trials.x, trials.z)
    of_input = same_points(encoded(embedding, trials.x), trials.z)
    if of_input.all() or problem.candidates is not None:
        return of_input
    lower, upper = problem.bounds
    inputs = np.clip(decoded(embedding, trials.z), lower, upper)
    return of_input | ((trials.round > 0) & same_points(inputs, trials.x))


def fingerprint(candidates: CandidateSet) -> FloatArray:
    """(b,) weighted means of the features of consecutive rows, at most 4096 of them.

    A set whose features are dear has cheaper numbers in their place, one row per candidate, in an attribute
    `identifying`.

    The weights are random and fixed, so that rows that change places, or one that changes by a millionth of
    the largest feature, show; what is kept does not grow with the list.
    """
    cheap = getattr(candidates, "identifying", None)
    features = np.asarray(candidates.features if cheap is None else cheap, float)
    total, width = features.shape
    rng = np.random.default_rng(0)
    scale = max(float(np.abs(features).max(initial=0.0)), 1e-300)
    rows = features @ (rng.uniform(0.5, 1.0, width) / (scale * width)) * rng.uniform(0.5, 1.0, total)
    return np.asarray(np.add.reduceat(rows, np.arange(0, total, _rows_per_block(total))))


def _rows_per_block(total: int) -> int:
    return -(-total // _BLOCKS)
