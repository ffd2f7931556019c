"""A Dask cluster gives what the process pool gives, and an error where it cannot."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import campaign_toys as toys
import pytest
from campaign_items import assert_same_file, compute, environment, journalled, wait_for, without_times

from hdsafebo.campaign.errors import CampaignError

# What the libraries below Dask will stop to support is not ours to mend.
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")


@dataclass
class Cluster:
    address: str
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]]


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cluster]:
    """A scheduler and two workers on the loopback address."""
    monkeypatch.setattr("hdsafebo.campaign.item.run", toys.run_toy)
    file = tmp_path / "scheduler.json"
    with (tmp_path / "cluster.log").open("wb") as log:

        def start(*arguments: str) -> subprocess.Popen[bytes]:
            options = ["--scheduler-file", str(file), "--no-dashboard"]
            command = [sys.executable, "-m", "dask", *arguments, *options]
            return subprocess.Popen(command, env=environment(), stdout=log, stderr=log, cwd=tmp_path)

        processes = [start("scheduler", "--host", "127.0.0.1", "--port", "0")]
        try:
            wait_for(file.exists, "the scheduler did not start")
            processes += [start("worker", "--nthreads", "1", "--no-nanny") for _ in range(2)]
            yield Cluster(json.loads(file.read_text())["address"], processes[0], processes[1:])
        finally:
            for process in processes:
                process.kill()
                process.wait()


def in_mid_run(root: Path, action) -> threading.Thread:  # type: ignore[no-untyped-def]
    """Do something once the runs below `root` are under way."""

    def wait_and_act() -> None:
        wait_for(lambda: journalled(root) > 8000, "no progress")
        action()

    thread = threading.Thread(target=wait_and_act)
    thread.start()
    return thread


@pytest.mark.slow
def test_the_file_is_that_of_the_pool_although_a_worker_is_killed(tmp_path: Path, cluster: Cluster) -> None:
    compute(tmp_path / "pool", seconds=0.05, seeds=4)
    killer = in_mid_run(tmp_path / "cluster", cluster.workers[0].kill)
    compute(tmp_path / "cluster", seconds=0.05, seeds=4, where={"scheduler": cluster.address})
    killer.join()
    assert cluster.workers[0].wait() == -signal.SIGKILL
    assert_same_file(without_times(tmp_path / "cluster"), without_times(tmp_path / "pool"))


@pytest.mark.slow
def test_a_cluster_without_workers_is_an_error_and_no_hang(
    tmp_path: Path, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    def kill_all() -> None:
        monkeypatch.setattr("hdsafebo.campaign.cluster._NO_WORKERS_S", 3)
        for worker in cluster.workers:
            worker.kill()

    killer = in_mid_run(tmp_path / "root", kill_all)
    with pytest.raises(CampaignError, match="no worker for 3 s; finished rounds are kept"):
        compute(tmp_path / "root", seconds=0.3, where={"scheduler": cluster.address})
    killer.join()


@pytest.mark.slow
def test_a_scheduler_that_dies_is_an_error_and_no_hang(tmp_path: Path, cluster: Cluster) -> None:
    killer = in_mid_run(tmp_path / "root", cluster.scheduler.kill)
    with pytest.raises(CampaignError, match="finished rounds are kept"):
        compute(tmp_path / "root", seconds=0.3, where={"scheduler": cluster.address})
    killer.join()


def test_a_scheduler_that_is_not_there_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hdsafebo.campaign.cluster._CONNECT_S", 1)
    with pytest.raises(CampaignError, match=r"compute\.scheduler 'tcp://127\.0\.0\.1:9': no Dask scheduler"):
        compute(tmp_path, where={"scheduler": "tcp://127.0.0.1:9"})
