"""Saving an optimiser to a file and going on from it as if nothing had happened, to the bit."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdsafebo.errors import HdSafeBOError, StateFileError
from hdsafebo.optimizers.core.fits import Fits
from hdsafebo.optimizers.core.ledger import Ledger
from hdsafebo.optimizers.core.state_file import read_state, write_state
from hdsafebo.optimizers.settings import OptimizerSettings
from hdsafebo.problem import Codec, Problem
from hdsafebo.search.space import SearchSpace
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray


class Persistent(Protocol):
    """What of an optimiser makes up its state (`optimizers.base.Optimizer` has all of it)."""

    name: ClassVar[str]
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
_METHOD = "method."
_CODES_CHECKED = 8


def save_optimizer(optimizer: Persistent, path: Path) -> None:
    """Write the state of an optimiser; see `Optimizer.save`."""
    method_state, method_arrays = optimizer.method_state()
    space = optimizer._space
    state = {
        "method": optimizer.name,
        "settings": optimizer.settings.model_dump(mode="json", exclude_unset=True),
        "problem": _identity(optimizer.problem),
        "embedded": optimizer.embedding is not None,
        "round": optimizer.round,
        "generator": optimizer.rng.bit_generator.state,
        "fits": optimizer._fits.to_json(),
        "method_state": method_state,
    }
    arrays = {_TRIALS + f.name: getattr(optimizer.trials, f.name) for f in fields(Trials)}
    arrays |= {_METHOD + name: value for name, value in method_arrays.items()}
    arrays["problem.bounds"] = optimizer.problem.bounds
    if space is not None:
        arrays["bounds"] = space.bounds
    write_state(path, state, arrays)


def load_optimizer(kind: type[T], path: Path, problem: Problem, embedding: Codec | None) -> T:
    """Read the state of an optimiser; see `Optimizer.load`."""
    state, arrays = read_state(path)
    try:
        _check_identity(kind, path, state, arrays, problem, embedding)
        optimizer = kind(problem, embedding=embedding, bounds=arrays.get("bounds"), **state["settings"])
        trials = Trials(**{f.name: arrays[_TRIALS + f.name] for f in fields(Trials)})
        _check_codes(path, trials, optimizer)
        optimizer._ledger.append(trials)
        optimizer.round = state["round"]
        optimizer.rng.bit_generator.state = state["generator"]
        optimizer._fits.restore(state["fits"])
        method_arrays = {n.removeprefix(_METHOD): a for n, a in arrays.items() if n.startswith(_METHOD)}
        optimizer.restore_method_state(state["method_state"], method_arrays)
    except StateFileError:
        raise
    except (HdSafeBOError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise StateFileError(f"{path}: damaged state: {type(error).__name__}: {error}") from error
    return optimizer


def _identity(problem: Problem) -> dict[str, Any]:
    safety = [[s.name, s.threshold, s.modelled, s.transform is not None] for s in problem.safety]
    candidates = None if problem.candidates is None else len(problem.candidates)
    return {"name": problem.name, "safety": safety, "candidates": candidates}


def _check_identity(
    kind: type[Persistent],
    path: Path,
    state: dict[str, Any],
    arrays: dict[str, Any],
    problem: Problem,
    embedding: Codec | None,
) -> None:
    """Refuse a state that belongs to something else."""
    if state["method"] != kind.name:
        raise StateFileError(f"{path}: state of method {state['method']!r}; expected {kind.name!r}")
    identity = _identity(problem)
    for key, value in identity.items():
        if state["problem"].get(key) != value:
            raise StateFileError(
                f"{path}: {key} of the problem was {state['problem'].get(key)!r}; expected {value!r}"
            )
    if not np.array_equal(arrays["problem.bounds"], problem.bounds):
        raise StateFileError(f"{path}: bounds of problem {problem.name!r} differ from those that were saved")
    if state["embedded"] != (embedding is not None):
        raise StateFileError(
            f"{path}: saved {'with' if state['embedded'] else 'without'} an embedding, expected the same"
        )


def _check_codes(path: Path, trials: Trials, optimizer: Persistent) -> None:
    """Refuse another embedding than the one the codes were made with, and tables that do not fit together."""
    if len({len(getattr(trials, f.name)) for f in fields(Trials)}) != 1:
        raise StateFileError(f"{path}: columns of the trials differ in length")
    if not np.array_equal(trials.id, np.arange(len(trials))):
        raise StateFileError(f"{path}: ids of the trials are not 0 to {len(trials) - 1}")
    if len(trials):
        some = trials[:_CODES_CHECKED]
        if not _belong(some, optimizer).all():
            raise StateFileError(f"{path}: the embedding gives other codes than those that were saved")


def _belong(trials: Trials, optimizer: Persistent) -> NDArray[np.bool_]:
    """(n,) True where the code is the input's, or the input is the code's (see `proposal.realise`)."""
    if optimizer.embedding is None:
        return _same_rows(trials.x, trials.z)
    encoded = _same_rows(np.asarray(optimizer.embedding.encode(trials.x), float), trials.z)
    if encoded.all() or optimizer.problem.candidates is not None:
        return encoded
    lower, upper = optimizer.problem.bounds
    decoded = np.clip(np.asarray(optimizer.embedding.decode(trials.z), float), lower, upper)
    return encoded | ((trials.round > 0) & _same_rows(decoded, trials.x))


def _same_rows(a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
    if a.shape != b.shape:
        return np.zeros(len(b), bool)
    return np.asarray(np.isclose(a, b, rtol=1e-6, atol=1e-9).all(axis=1))
