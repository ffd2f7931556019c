"""Computing with one thread: sums in another order have other bits, and suggestions would be other ones."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

_LOADING = ("OMP_NUM_THREADS", "MKL_NUM_THREADS")  # what torch looks at when it is loaded
_TURN = RLock()  # numbers of threads are the process's: who is done first must not give them back to others


@contextmanager
def one_thread() -> Iterator[None]:
    """One thread in every numerical library while the body runs.

    Also in torch, which counts its own, and which some methods load only when they propose; it then goes on
    with one.
    """
    with _TURN, threadpool_limits(1), _loaded_with_one():
        torch = sys.modules.get("torch")
        if torch is None:
            yield
            return
        before = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(before)


@contextmanager
def _loaded_with_one() -> Iterator[None]:
    """Have libraries that are loaded within the block take one thread."""
    before = {variable: os.environ.get(variable) for variable in _LOADING}
    os.environ.update(dict.fromkeys(_LOADING, "1"))
    try:
        yield
    finally:
        for variable, value in before.items():
            if value is None:
                del os.environ[variable]
            else:
                os.environ[variable] = value
