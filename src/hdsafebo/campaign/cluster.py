"""The Dask cluster as an executor, with an error wherever Dask would wait without end."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor
from contextlib import contextmanager
from typing import TYPE_CHECKING

from hdsafebo.campaign.errors import CampaignError

if TYPE_CHECKING:
    from distributed import Client

_CONNECT_S = 15
_NO_WORKERS_S = 60


@contextmanager
def connected(scheduler: str) -> Iterator[tuple[Executor, Callable[[], None]]]:
    """Connect to a cluster, which gives the jobs of a dying worker to another worker.

    Args:
        scheduler: its address, such as `tcp://10.0.0.1:8786`.

    Yields:
        An executor, and a function that raises when the cluster is of no use any more.

    Raises:
        CampaignError: Dask is missing, or the cluster is out of reach, without workers for a minute, or
            lost the workers of one job repeatedly. Finished rounds are in the journals.
    """
    try:
        from distributed import Client, KilledWorker
    except ImportError as error:
        raise CampaignError(
            "compute.scheduler is set but Dask is not installed: pip install 'hdsafebo[cluster]'"
        ) from error
    try:
        client = Client(scheduler, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise _failed(scheduler, f"no Dask scheduler answers at this address ({error})") from error
    try:
        yield client.get_executor(pure=False), _Vitals(client, scheduler).check
    except CancelledError as error:
        raise _failed(scheduler, "the scheduler dropped the runs") from error
    except KilledWorker as error:
        raise _failed(scheduler, f"a run lost its workers repeatedly, out of memory? ({error})") from error
    finally:
        client.close(timeout=_CONNECT_S)


class _Vitals:
    """Notices that the scheduler or all workers are gone."""

    def __init__(self, client: Client, scheduler: str) -> None:
        self._client = client
        self._scheduler = scheduler
        self._last_seen = time.monotonic()

    def check(self) -> None:
        try:
            workers = self._client.scheduler_info()["workers"]
        except OSError as error:
            raise _failed(self._scheduler, f"the scheduler is gone ({error})") from error
        now = time.monotonic()
        if workers:
            self._last_seen = now
        elif now - self._last_seen > _NO_WORKERS_S:
            raise _failed(self._scheduler, f"no worker for {_NO_WORKERS_S} s")


def _failed(scheduler: str, what: str) -> CampaignError:
    return CampaignError(
        f"compute.scheduler {scheduler!r}: {what}; finished rounds are kept, start again to continue"
    )
