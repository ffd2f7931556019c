"""Calls that change an optimiser: one at a time, and each in whole or not at all.

An interrupt (Ctrl-C) may arrive between any two instructions of a call, and a second thread may call while a
first one is at work. Both would leave an optimiser whose trials, trust region and fits speak of different
times.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from copy import deepcopy
from dataclasses import dataclass
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from hdsafebo.optimizers.core.fits import Fits
from hdsafebo.optimizers.core.ledger import Ledger
from hdsafebo.trials import Trials
from hdsafebo.typing import FloatArray, IntArray

MethodState = tuple[dict[str, Any], dict[str, NDArray[Any]]]


class Changeable(Protocol):
    """What of an optimiser a call may change (`optimizers.base.Optimizer` has all of it)."""

    rng: np.random.Generator
    round: int
    _lock: AbstractContextManager[bool]
    _ledger: Ledger
    _fits: Fits
    elsewhere: IntArray
    _context: FloatArray

    def hold(self, context: FloatArray) -> None: ...

    def method_state(self) -> MethodState: ...

    def restore_method_state(self, state: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None: ...


@dataclass(frozen=True)
class _Snapshot:
    """Where an optimiser stands. Tables of trials and fits are never written to, so that references do."""

    trials: Trials
    fits: Fits
    generator: Any
    round: int
    elsewhere: IntArray
    context: FloatArray
    method: MethodState

    @classmethod
    def of(cls, optimizer: Changeable) -> _Snapshot:
        return cls(
            optimizer._ledger.trials,
            optimizer._fits.copy(),
            optimizer.rng.bit_generator.state,
            optimizer.round,
            optimizer.elsewhere,
            optimizer._context,
            deepcopy(optimizer.method_state()),
        )

    def restore(self, optimizer: Changeable) -> None:
        optimizer._ledger.trials = self.trials  # first: methods may look at the trials when they go back
        optimizer._fits = self.fits
        optimizer.rng.bit_generator.state = self.generator
        optimizer.round = self.round
        optimizer.elsewhere = self.elsewhere
        optimizer.hold(self.context)
        optimizer.restore_method_state(*self.method)


O = TypeVar("O", bound=Changeable)  # noqa: E741 (an optimiser)
P = ParamSpec("P")
R = TypeVar("R")


def all_or_nothing(change: Callable[Concatenate[O, P], R]) -> Callable[Concatenate[O, P], R]:
    """A method of an optimiser that ends as if it had not begun when it fails or is interrupted."""

    @wraps(change)
    def guarded(self: O, *args: P.args, **kwargs: P.kwargs) -> R:
        with self._lock:
            before = _Snapshot.of(self)
            try:
                return change(self, *args, **kwargs)
            except BaseException:
                _go_back(self, before)
                raise

    return guarded


def _go_back(optimizer: Changeable, before: _Snapshot) -> None:
    """Restore, also when someone who waits presses Ctrl-C once more; the first interrupt is raised anyway."""
    while True:
        try:
            before.restore(optimizer)
        except KeyboardInterrupt:
            continue
        return


def one_at_a_time(look: Callable[Concatenate[O, P], R]) -> Callable[Concatenate[O, P], R]:
    """A method of an optimiser that waits until no other thread changes the optimiser."""

    @wraps(look)
    def guarded(self: O, *args: P.args, **kwargs: P.kwargs) -> R:
        with self._lock:
            return look(self, *args, **kwargs)

    return guarded
