"""Computing with one thread: sums in another order have other bits, and suggestions would be other ones."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from threading import RLock

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from hdsafebo.campaign.executor import loading_with_one_thread

_TURN = RLock()  # numbers of threads are the process's: who is done first must not give them back to others


@contextmanager
def one_thread() -> Iterator[None]:
    """One thread in every numerical library while the body runs.

    Also in torch, which counts its own, and which some methods load only when they propose; it then goes on
    with one.
    """
    with _TURN, threadpool_limits(1), loading_with_one_thread(), ExitStack() as stack:
        if "torch" in sys.modules:
            from hdsafebo.embeddings.training.loop import one_torch_thread

            stack.enter_context(one_torch_thread())
        yield
