"""Saving an optimiser to a file and going on from it as if nothing had happened, to the bit."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdsafebo.errors import HdSafeBOError, StateFileError
from hdsafebo.optimizers.core.fits import Fits
from hdsafebo.optimizers.core.identity import (
    check_bounds,
    check_codes,
    check_evidence,
    check_identity,
    evidence_of,
    identity_of,
)
from hdsafebo.optimizers.core.ledger import Ledger
from hdsafebo.optimizers.core.packing import Packed, pack, steps_of, unpack
from hdsafebo.optimizers.core.state_file import read_state, write_state
from hdsafebo.optimizers.settings import OptimizerSettings
from hdsafebo.problem import Codec, Problem
from hdsafebo.search.space import SearchSpace
from hdsafebo.trials import Status, Trials


class Persistent(Protocol):
    """What of an optimiser makes up its state (`optimizers.base.Optimizer` has all of it)."""

    name: ClassVar[str]
    searches_codes: ClassVar[bool]
    problem: Problem
    embedding: Codec | None
    rng: np.random.Generator
    round: int
    _space: SearchSpace | None
    _ledger: Ledger
    _fits: Fits

    def __init__(
        self, problem: Problem, *, embedding: Codec | None, bounds: ArrayLike | None, **settings: Any
    ) -> None: ...

    @property
    def settings(self) -> OptimizerSettings: ...

    @property
    def trials(self) -> Trials: ...

    def method_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]: ...

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None: ...


T = TypeVar("T", bound=Persistent)
_TRIALS = "trials."
_PACKED = "packed."
_METHOD = "method."
_PROBLEM = "problem."


def save_optimizer(optimizer: Persistent, path: Path) -> None:
    """Write the state of an optimiser; see `Optimizer.save`."""
    method_state, method_arrays = optimizer.method_state()
    space = optimizer._space
    state = {
        "method": optimizer.name,
        "settings": optimizer.settings.model_dump(mode="json", exclude_unset=True),
        "problem": identity_of(optimizer.problem),
        "embedded": optimizer.embedding is not None,
        "round": optimizer.round,
        "generator": optimizer.rng.bit_generator.state,
        "fits": optimizer._fits.to_json(),
        "method_state": method_state,
    }
    trials = optimizer.trials
    packed = _packed_inputs(optimizer.problem, trials)
    left_out = {"z"} if trials.z is trials.x else set()
    left_out |= {"x"} if packed else set()
    arrays = {_TRIALS + f.name: getattr(trials, f.name) for f in fields(Trials) if f.name not in left_out}
    arrays |= {_PACKED + name: value for name, value in packed.items()}
    arrays |= {_METHOD + name: value for name, value in method_arrays.items()}
    evidence = evidence_of(optimizer.problem, optimizer.trials)
    arrays |= {_PROBLEM + name: value for name, value in evidence.items()}
    if space is not None:
        arrays["bounds"] = space.bounds
    write_state(path, state, arrays)


def load_optimizer(kind: type[T], path: Path, problem: Problem, embedding: Codec | None) -> T:
    """Read the state of an optimiser; see `Optimizer.load`."""
    state, arrays = read_state(path)
    try:
        if state["method"] != kind.name:
            raise StateFileError(f"{path}: state of method {state['method']!r}; expected {kind.name!r}")
        check_identity(path, state["problem"], problem)
        if state["embedded"] != (embedding is not None and kind.searches_codes):
            raise StateFileError(
                f"{path}: saved {'with' if state['embedded'] else 'without'} an embedding, expected the same"
            )
        optimizer = kind(problem, embedding=embedding, bounds=arrays.get("bounds"), **state["settings"])
        if _TRIALS + "x" not in arrays:
            arrays[_TRIALS + "x"] = _unpacked_inputs(problem, _part(arrays, _PACKED))
        arrays.setdefault(_TRIALS + "z", arrays[_TRIALS + "x"])  # without an embedding, codes are inputs
        trials = Trials(**{f.name: arrays[_TRIALS + f.name] for f in fields(Trials)})
        check_bounds(path, _part(arrays, _PROBLEM), problem)
        _check_table(path, trials, state["round"], problem)
        check_evidence(path, _part(arrays, _PROBLEM), problem, trials)
        check_codes(path, trials, problem, optimizer.embedding)
        optimizer._ledger.append(trials)
        optimizer.round = state["round"]
        optimizer.rng.bit_generator.state = state["generator"]
        optimizer._fits.restore(state["fits"])
        optimizer.restore_method_state(state["method_state"], _part(arrays, _METHOD))
    except StateFileError:
        raise
    except (HdSafeBOError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise StateFileError(f"{path}: damaged state: {type(error).__name__}: {error}") from error
    return optimizer


def _packed_inputs(problem: Problem, trials: Trials) -> Packed:
    """The inputs in few bytes, where all are multiples of the problem's resolution; else nothing."""
    steps = None if problem.resolution is None else steps_of(trials.x, problem.resolution)
    return {} if steps is None or len(steps) == 0 else pack(steps)


def _unpacked_inputs(problem: Problem, packed: dict[str, NDArray[Any]]) -> NDArray[np.float64]:
    """(n, D) what `_packed_inputs` packed."""
    if problem.resolution is None:
        raise ValueError("inputs were saved as multiples of a resolution, and the problem has none")
    d = problem.bounds.shape[1]
    return np.multiply(unpack(packed, d), problem.resolution, dtype=float)


def _part(arrays: dict[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    """The arrays whose names have a prefix, without it."""
    return {n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)}


def _check_table(path: Path, trials: Trials, rounds: Any, problem: Problem) -> None:
    """Refuse a table that no optimiser of this problem could have.

    Raises:
        StateFileError: a column has another type, length or range.
    """
    n, d = len(trials), problem.bounds.shape[1]
    if isinstance(rounds, bool) or not isinstance(rounds, int) or rounds < 0:
        raise StateFileError(f"{path}: {rounds!r} rounds; expected a whole number, at least 0")
    model = Trials.pending(np.empty((0, d)), np.empty((0, 1)), len(problem.safety))
    for f in fields(Trials):
        column, expected = getattr(trials, f.name), getattr(model, f.name)
        if column.dtype != expected.dtype or column.ndim != expected.ndim or len(column) != n:
            raise StateFileError(
                f"{path}: trials.{f.name} has type {column.dtype} and shape {column.shape}; expected "
                f"{expected.dtype} and {n} rows of {expected.ndim - 1} dimensions"
            )
    completed = trials.status == Status.COMPLETED
    total = 0 if problem.candidates is None else len(problem.candidates)
    sound = {
        "id": np.array_equal(trials.id, np.arange(n)),
        "x": trials.x.shape[1] == d and np.isfinite(trials.x).all(),
        "z": np.isfinite(trials.z).all(),
        "status": np.isin(trials.status, list(Status)).all(),
        "objective": np.array_equal(np.isfinite(trials.objective), completed)
        and not np.isinf(trials.objective).any(),
        "safety": trials.safety.shape[1] == len(problem.safety)
        and np.array_equal(np.isfinite(trials.safety).all(axis=1), completed)
        and not np.isinf(trials.safety).any(),
        "candidate": (trials.candidate >= -1).all() and (trials.candidate < total).all(),
        "round": (trials.round >= 0).all() and (trials.round <= rounds).all(),
        "predicted_safe_probability": not (np.abs(trials.predicted_safe_probability - 0.5) > 0.5).any(),
        "violation_bound": not (trials.violation_bound < 0).any(),
        "trust_region_length": not (trials.trust_region_length < 0).any(),
    }
    wrong = [name for name, right in sound.items() if not right]
    if wrong:
        raise StateFileError(f"{path}: values of trials.{wrong[0]} that no trial of this problem can have")
