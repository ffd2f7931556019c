"""Names of processes, by which it is known later whether one still runs."""

from __future__ import annotations

import os
import platform


def this_process() -> str:
    """Host, number and start of this process; numbers of processes are used again."""
    import psutil

    return f"{platform.node()} {os.getpid()} {psutil.Process().create_time():.2f}"


def is_alive(process: str) -> bool:
    """Whether a process still runs, as far as can be known from this host.

    Args:
        process: as `this_process` names it.
    """
    import psutil

    try:
        host, number, start = process.split(" ")
        if host != platform.node():
            return True
        return abs(psutil.Process(int(number)).create_time() - float(start)) < 1.0
    except (ValueError, psutil.Error):
        return False
