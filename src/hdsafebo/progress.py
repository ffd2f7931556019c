"""Progress on long work: a bar on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Protocol, TypeVar

_LOG = logging.getLogger(__name__)
T = TypeVar("T")
_PLAIN_INTERVAL_S = 15.0


class Advance(Protocol):
    """Reports that `steps` more units are done; `note` is a short state text (a loss, a best value)."""

    def __call__(self, steps: int = 1, note: str = "") -> None: ...


@contextmanager
def progress(total: int, description: str) -> Iterator[Advance]:
    """Show the progress of `total` units of work on standard error.

    Args:
        total: number of units.
        description: what is being done.

    Yields:
        A function to call as units are finished.
    """
    if sys.stderr.isatty():
        yield from _bar(total, description)
    else:
        yield from _lines(total, description)


def track(items: Iterable[T], description: str, total: int | None = None) -> Iterator[T]:
    """Iterate over `items` with progress; `total` is needed when they have no length."""
    count = len(items) if total is None else total  # type: ignore[arg-type]
    with progress(count, description) as advance:
        for item in items:
            yield item
            advance()


def _bar(total: int, description: str) -> Iterator[Advance]:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("eta"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=Console(stderr=True)) as bars:
        task = bars.add_task(description, total=total, note="")

        def advance(steps: int = 1, note: str = "") -> None:
            bars.update(task, advance=steps)
            if note:
                bars.update(task, note=note)

        yield advance


def _lines(total: int, description: str) -> Iterator[Advance]:
    start = last = time.monotonic()
    done = 0

    def advance(steps: int = 1, note: str = "") -> None:
        nonlocal done, last
        done += steps
        now = time.monotonic()
        if now - last >= _PLAIN_INTERVAL_S:
            last = now
            eta = (now - start) / max(done, 1) * (total - done)
            suffix = f", {note}" if note else ""
            _LOG.info("%s: %d/%d, %.0f s, eta %.0f s%s", description, done, total, now - start, eta, suffix)

    yield advance
    _LOG.info("%s: %d/%d in %.1f s", description, done, total, time.monotonic() - start)
