"""Jobs on a process pool: the same bits for any number of workers, and an answer when workers die."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import campaign_jobs as jobs
import pytest

from hdsafebo.campaign.errors import CampaignError
from hdsafebo.campaign.executor import execute


def results_of(function, items, workers=1):  # type: ignore[no-untyped-def]
    found = {}
    execute(
        function, items, lambda item, result: found.__setitem__(item, result), jobs.Quiet(), workers=workers
    )
    return found


def test_results_do_not_depend_on_the_number_of_workers() -> None:
    seeds = [1, 2, 3, 4]
    alone = results_of(jobs.matrix_product, seeds, workers=1)
    assert alone == results_of(jobs.matrix_product, seeds, workers=3)
    assert len(set(alone.values())) == 4


def test_every_worker_computes_with_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(variable, "2")
    assert results_of(jobs.threads, [0]) == {0: ("1", 1, 1)}
    assert os.environ["OMP_NUM_THREADS"] == "2"


def test_a_job_whose_worker_died_is_done_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    paths = [str(tmp_path / "a"), str(tmp_path / "b")]
    found = results_of(jobs.die_once, paths[:1])
    assert set(found) == set(paths[:1])
    assert "NOTICE: a worker process died" in caplog.text


def test_workers_that_die_again_are_an_error_and_no_hang() -> None:
    with pytest.raises(CampaignError, match=r"died twice .* with 2 runs unfinished"):
        results_of(jobs.die, [1, 2])


def test_an_error_in_a_job_arrives_and_the_watcher_is_told_to_stop() -> None:
    watcher = jobs.Quiet()
    with pytest.raises(ValueError, match="this run failed"):
        execute(jobs.fail, [1, 2, 3], lambda item, result: None, watcher, workers=1)
    assert watcher.stops == 1


def test_workers_end_when_their_parent_is_killed(tmp_path: Path) -> None:
    marker = tmp_path / "pid"
    script = (
        "import campaign_jobs as jobs\nfrom hdsafebo.campaign.executor import execute\n"
        "if __name__ == '__main__':\n"
        f"    execute(jobs.sleep, [{str(marker)!r}], print, jobs.Quiet(), workers=1)\n"
    )
    (tmp_path / "campaign.py").write_text(script)
    here = str(Path(jobs.__file__).parent)
    path = os.pathsep.join([here, *os.environ.get("PYTHONPATH", "").split(os.pathsep)])
    parent = subprocess.Popen(
        [sys.executable, str(tmp_path / "campaign.py")], env=os.environ | {"PYTHONPATH": path}
    )
    deadline = time.monotonic() + 60
    while not (marker.exists() and marker.read_text()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    worker = int(marker.read_text())
    parent.kill()
    parent.wait()
    while _alive(worker):
        assert time.monotonic() < deadline, "the worker outlived its parent"
        time.sleep(0.05)


def test_nobody_starts_workers_that_outlive_a_killed_parent(project_root: Path) -> None:
    folders = [project_root / name for name in ("src", "stages", "benchmarks", "examples")]
    files = [path for folder in folders for path in folder.rglob("*.py")]
    assert [path.name for path in files if "ProcessPoolExecutor(" in path.read_text()] == ["executor.py"]


def _alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False
