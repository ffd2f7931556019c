"""Jobs that worker processes import by name."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np


class Quiet:
    """A watcher that counts."""

    def __init__(self) -> None:
        self.polls = 0
        self.stops = 0

    def poll(self) -> None:
        self.polls += 1

    def stop(self) -> None:
        self.stops += 1


def matrix_product(seed: int) -> bytes:
    """A sum whose bits depend on the number of BLAS threads."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(600, 700))
    return bytes((a @ a.T).sum(axis=0).tobytes())


def threads(_: int) -> tuple[str, int, int]:
    """Number of threads that OpenMP libraries, BLAS and torch would use."""
    import torch
    from threadpoolctl import threadpool_info

    return (
        os.environ["OMP_NUM_THREADS"],
        max(pool["num_threads"] for pool in threadpool_info()),
        torch.get_num_threads(),
    )


def die_once(path: str) -> int:
    """Kill the own process unless it was done before."""
    marker = Path(path)
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def die(_: int) -> None:
    """Kill the own process."""
    os.kill(os.getpid(), signal.SIGKILL)


def fail(_: int) -> None:
    """Fail in the ordinary way."""
    raise ValueError("this run failed")


def sleep(path: str) -> None:
    """Say that the job runs, then sleep longer than a test may take."""
    Path(path).write_text(str(os.getpid()))
    time.sleep(600)
