"""Computing with one thread: sums in another order have other bits, and a seed would give other results."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_TURN = RLock()  # numbers of threads are the process's: who is done first must not give them back to others


@contextmanager
def one_thread() -> Iterator[None]:
    """One thread in every numerical library while the body runs.

    Also in torch, which counts its own. Libraries that are loaded within the body go on with one thread after
    it. Threads of a process that compute so take turns.
    """
    with _TURN, threadpool_limits(1), loading_with_one_thread(), _one_torch_thread():
        yield


@contextmanager
def loading_with_one_thread() -> Iterator[None]:
    """Libraries that are loaded within the block, also by processes that start there, take one thread."""
    before = {variable: os.environ.get(variable) for variable in _VARIABLES}
    os.environ.update(dict.fromkeys(_VARIABLES, "1"))
    try:
        yield
    finally:
        for variable, value in before.items():
            if value is None:
                del os.environ[variable]
            else:
                os.environ[variable] = value


def keep_to_one_thread() -> None:
    """One thread for the rest of this process, whatever is loaded later."""
    os.environ.update(dict.fromkeys(_VARIABLES, "1"))
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)
    threadpool_limits(1)


@contextmanager
def _one_torch_thread() -> Iterator[None]:
    torch = sys.modules.get("torch")  # seconds to load, and not every body needs it
    if torch is None:
        yield
        return
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
