"""Many independent jobs on one `concurrent.futures.Executor`: a process pool, or a Dask cluster.

Jobs are named functions of plain data, so that results cannot depend on where they run or on how many
run at once. Every job computes with one BLAS and one torch thread: sums in another order have other bits.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Protocol, TypeVar

from hdsafebo.campaign.errors import CampaignError
from hdsafebo.threads import keep_to_one_thread, loading_with_one_thread

Item = TypeVar("Item")
Result = TypeVar("Result")

_LOG = logging.getLogger(__name__)
_POLL_S = 0.5


class Watcher(Protocol):
    """Follows a campaign from the process that started it."""

    def poll(self) -> None:
        """Called about twice a second while jobs run."""

    def stop(self) -> None:
        """Called once when a job failed: the jobs that still run should end early."""


def execute(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    on_result: Callable[[Item, Result], None],
    watcher: Watcher,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
) -> None:
    """Call `function` on every item, in parallel.

    Args:
        function: a function that a worker can import.
        items: plain data.
        on_result: called in this process as jobs finish, in no fixed order.
        watcher: follows the progress.
        workers: processes of the pool; None takes one per core of this process.
        scheduler: address of a Dask scheduler; None uses a process pool.

    Raises:
        CampaignError: worker processes died repeatedly, or the cluster is out of reach.
        Exception: what the first failing job raised; jobs that run at that time end first.
    """
    if scheduler is not None:
        from hdsafebo.campaign.cluster import connected

        with connected(scheduler) as (executor, alive):
            collect(executor, function, items, on_result, watcher, alive)
    else:
        _in_processes(function, items, on_result, watcher, workers or len(os.sched_getaffinity(0)))


def single_threaded(function: Callable[[Item], Result], item: Item) -> Result:
    """Call `function(item)` in a process that computes with one thread from then on."""
    keep_to_one_thread()
    return function(item)


def _in_processes(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    on_result: Callable[[Item, Result], None],
    watcher: Watcher,
    workers: int,
) -> None:
    """Run on a pool; jobs that a dying worker takes along are submitted once more, to a new pool."""
    lost = list(items)
    for attempt in ("first", "second"):
        with loading_with_one_thread(), process_pool(min(workers, len(lost))) as pool:
            lost = collect(pool, function, lost, on_result, watcher)
        if not lost:
            return
        if attempt == "first":
            _LOG.warning(
                "NOTICE: a worker process died (killed, or out of memory); %d unfinished runs continue from "
                "their journals in new processes",
                len(lost),
            )
    raise CampaignError(
        f"worker processes died twice (killed, or out of memory) with {len(lost)} runs unfinished; "
        "their finished rounds are kept: start again, with fewer compute.workers if memory is short"
    )


def process_pool(workers: int) -> ProcessPoolExecutor:
    """Processes that start anew, not as copies of this one, and end with it."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, mp_context=context, initializer=_end_with_parent)


def _end_with_parent() -> None:
    """Let this worker end when the process that started it is gone, even if that was killed.

    A worker left behind would compute the same run beside the next start.
    """
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True, name="end-with-parent").start()


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Have processes that start within the block never see Ctrl-C, which this one sees after the block.

    A terminal sends it to all processes. Workers leave it to the one that leads them, which has their runs
    end after the round. A process inherits what its parent holds back, from its first instruction on.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def collect(
    executor: Executor,
    function: Callable[[Item], Result],
    items: Sequence[Item],
    on_result: Callable[[Item, Result], None],
    watcher: Watcher,
    check: Callable[[], None] = lambda: None,
) -> list[Item]:
    """Submit all items, pass on their results, and return those whose worker died.

    `check` is called about twice a second and raises when waiting on is of no use.
    """
    jobs: dict[Future[Result], Item] = {}
    lost: list[Item] = []
    try:
        with _interrupts_held():
            for item in items:
                try:
                    jobs[executor.submit(single_threaded, function, item)] = item
                except BrokenProcessPool:
                    lost.append(item)
        pending = set(jobs)
        while pending:
            done, pending = wait(pending, timeout=_POLL_S, return_when=FIRST_COMPLETED)
            for job in done:
                try:
                    result = job.result()
                except BrokenProcessPool:
                    lost.append(jobs[job])
                else:
                    on_result(jobs[job], result)
            watcher.poll()
            check()
    except BaseException:
        watcher.stop()
        for job in jobs:
            job.cancel()
        raise
    return lost
