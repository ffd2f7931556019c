"""Steps of a session that is open in memory: one at a time, and none of them in half.

An interrupt (Ctrl-C) may arrive between any two instructions of a step, and a second thread may call while a
first one is at work. Either would leave a session that holds half of a step, and would append to the log what
does not follow from it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import wraps
from typing import Concatenate, ParamSpec, Protocol, TypeVar

from hdsafebo.errors import HdSafeBOError
from hdsafebo.session.errors import AuditError


class Followed(Protocol):
    """What of an open session the turns need."""

    _turn: threading.Lock
    _undone: bool

    def begin_anew(self) -> None: ...


S = TypeVar("S", bound=Followed)
P = ParamSpec("P")
R = TypeVar("R")


def one_at_a_time(step: Callable[Concatenate[S, P], R]) -> Callable[Concatenate[S, P], R]:
    """A step that waits for those of other threads. Steps that call each other call what is within."""

    @wraps(step)
    def alone(self: S, *args: P.args, **kwargs: P.kwargs) -> R:
        with self._turn:
            return in_turn(self, step, *args, **kwargs)

    return alone


def in_turn(session: S, step: Callable[Concatenate[S, P], R], *args: P.args, **kwargs: P.kwargs) -> R:
    """What a step returns; whoever calls holds the turn.

    A refusal leaves the session as it was. After anything else that was raised the next step begins with the
    log, whose entries are whole.
    """
    if session._undone:
        session.begin_anew()
    session._undone = True
    try:
        result = step(session, *args, **kwargs)
    except AuditError:
        raise
    except HdSafeBOError:
        session._undone = False
        raise
    session._undone = False
    return result
