"""Signs of life between the leading process of a campaign and its runs."""

from __future__ import annotations

from pathlib import Path

import campaign_toys as toys
import pytest

from hdsafebo.campaign.errors import CampaignError
from hdsafebo.campaign.progress import Beacon, ProgressWatcher


class Bar:
    """A progress bar that adds up."""

    def __init__(self) -> None:
        self.total = 0
        self.note = ""

    def __call__(self, steps: int = 1, note: str = "") -> None:
        self.total += steps
        self.note = note


def test_trials_of_all_runs_move_one_bar(tmp_path: Path) -> None:
    bar = Bar()
    specs = [toys.toy_spec(tmp_path, seed=seed) for seed in (1, 2)]
    watcher = ProgressWatcher(Path(specs[0].progress), [1, 2], bar)
    watcher.poll()
    assert bar.total == 0
    Beacon(specs[0]).report(10)
    Beacon(specs[1]).report(4)
    watcher.poll()
    watcher.poll()
    assert bar.total == 14
    Beacon(specs[1]).report(2)  # a run that was submitted again begins with the rounds of its journal
    watcher.poll()
    assert bar.total == 14
    watcher.finish(1, 30)
    assert (bar.total, bar.note) == (34, "runs 1/2")


def test_a_run_ends_when_the_campaign_is_stopped_or_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = toys.toy_spec(tmp_path)
    clock = [0.0]
    monkeypatch.setattr("hdsafebo.campaign.progress.time.monotonic", lambda: clock[0])
    beacon, watcher = Beacon(spec), ProgressWatcher(Path(spec.progress), [spec.seed], Bar())
    clock[0] = 1000.0
    beacon.report(1)  # no sign of the leading process at all: the directory is not shared
    for _ in range(5):
        watcher.poll()
        clock[0] += 110.0
        beacon.report(2)
    clock[0] += 130.0
    with pytest.raises(CampaignError, match="the campaign's process is gone; the run's rounds are kept"):
        beacon.report(3)
    watcher.poll()
    beacon.report(3)
    watcher.stop()
    with pytest.raises(CampaignError, match="stopped as another one failed"):
        beacon.report(4)


def test_a_run_goes_on_where_progress_cannot_be_written(tmp_path: Path) -> None:
    spec = toys.toy_spec(tmp_path)
    Path(spec.progress).rmdir()
    Beacon(spec).report(1)
