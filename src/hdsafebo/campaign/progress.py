"""How far the runs of a campaign are: small files that its workers and its leading process exchange.

Files rather than a queue: a worker that is killed cannot leave a lock behind, and workers of a cluster
need nothing but the file system that they share anyway.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from hdsafebo.campaign.errors import CampaignError
from hdsafebo.campaign.run_spec import RunSpec
from hdsafebo.files.bounded import read_text
from hdsafebo.progress import Advance

_STOP = "stop"
_LEADER = "leader"
_LEADER_SILENCE_S = 120.0


class Beacon:
    """A run's end: tells how many trials are done, and hears whether the campaign is still led.

    Without the latter, a worker of a cluster would finish a run for a campaign that was killed long ago, and
    keep it from the campaign that was started in its place.
    """

    def __init__(self, spec: RunSpec) -> None:
        self.seed = spec.seed
        self._directory = Path(spec.progress)
        self._leader: str | None = None
        self._leader_seen = time.monotonic()

    def report(self, trials: int) -> None:
        """Say how many trials are done.

        Raises:
            CampaignError: the campaign was stopped, or its leading process is gone.
        """
        self._check_leader()
        if (self._directory / _STOP).exists():
            raise CampaignError(f"run {self.seed} was stopped as another one failed; its rounds are kept")
        with suppress(OSError):  # a sign of life is not worth a run
            (self._directory / str(self.seed)).write_text(str(trials))

    def _check_leader(self) -> None:
        try:
            leader = read_text(self._directory / _LEADER)
        except OSError:
            return  # a directory that is not shared: nothing to know
        now = time.monotonic()
        if leader != self._leader:
            self._leader, self._leader_seen = leader, now
        elif now - self._leader_seen > _LEADER_SILENCE_S:
            raise CampaignError(f"run {self.seed}: the campaign's process is gone; the run's rounds are kept")


class ProgressWatcher:
    """The campaign's end: moves a progress bar; implements `executor.Watcher`.

    Args:
        directory: where the runs write.
        seeds: the runs.
        advance: moves the bar, in trials.
    """

    def __init__(self, directory: Path, seeds: Sequence[int], advance: Advance) -> None:
        self._directory = directory
        self._done = dict.fromkeys(seeds, 0)
        self._advance = advance
        self._finished = 0
        self._polls = 0

    def poll(self) -> None:
        """Read how far the runs are, and show that this process lives."""
        self._polls += 1
        with suppress(OSError):
            (self._directory / _LEADER).write_text(str(self._polls))
        for seed in self._done:
            with suppress(OSError, ValueError):  # the worker has not written its file yet, or is writing
                self._set(seed, int(read_text(self._directory / str(seed))))

    def finish(self, seed: int, trials: int) -> None:
        """A run is complete."""
        self._finished += 1
        self._set(seed, trials)

    def stop(self) -> None:
        """Ask the runs that still compute to end after their round."""
        with suppress(OSError):
            (self._directory / _STOP).touch()

    def _set(self, seed: int, trials: int) -> None:
        if trials > self._done[seed]:
            self._advance(trials - self._done[seed], f"runs {self._finished}/{len(self._done)}")
            self._done[seed] = trials
