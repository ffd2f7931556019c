"""The log: nothing acknowledged is lost, repeated, changed or silently damaged."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from hdsafebo.campaign.journal import Journal
from hdsafebo.errors import JournalError

WRITER = """
import sys
from pathlib import Path
from hdsafebo.campaign.journal import Journal
path, first, count = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
with Journal(path) as journal:
    for i in range(first, first + count):
        journal.append(f"trial-{i}", {"objective": i / 7, "x": [i] * 20})
        print(i, flush=True)
"""


def spawn_writer(path: Path, first: int, count: int) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", WRITER, str(path), str(first), str(count)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def test_records_come_back_in_order_and_to_the_bit(tmp_path: Path) -> None:
    values = {f"k{i}": {"v": float(v)} for i, v in enumerate(np.random.default_rng(0).normal(size=50))}
    with Journal(tmp_path / "deep" / "er" / "log") as journal:
        for key, value in values.items():
            assert journal.append(key, value)
    with Journal(tmp_path / "deep" / "er" / "log") as journal:
        assert journal.records == values
        assert list(journal.records) == list(values)


def test_the_same_record_a_hundred_times_is_one_and_a_conflict_keeps_the_first(tmp_path: Path) -> None:
    with Journal(tmp_path / "log") as journal:
        assert [journal.append("a", {"v": 0.1}) for _ in range(100)] == [True] + [False] * 99
        size = journal.path.stat().st_size
        with pytest.raises(JournalError, match="'a' is already there with another value"):
            journal.append("a", {"v": 0.2})
        assert journal.path.stat().st_size == size
    with Journal(tmp_path / "log") as journal:
        assert journal.records == {"a": {"v": 0.1}}


@pytest.mark.parametrize("again", [False, True])
def test_nothing_is_acknowledged_in_a_file_that_was_deleted(tmp_path: Path, again: bool) -> None:
    with Journal(tmp_path / "log") as journal:
        journal.append("a", 1)
        journal.path.unlink()
        if again:
            journal.path.touch()
        with pytest.raises(JournalError, match="was deleted or replaced while in use"):
            journal.append("b", 2)


def test_two_open_journals_see_each_other(tmp_path: Path) -> None:
    with Journal(tmp_path / "log") as one, Journal(tmp_path / "log") as two:
        one.append("a", 1)
        two.append("b", 2)
        assert not one.append("b", 2)
        with pytest.raises(JournalError, match="first is kept"):
            two.append("a", 3)
        two.append("c", 3)
        one.refresh()
        assert one.records == two.records == {"a": 1, "b": 2, "c": 3}


def test_sixteen_processes_tell_two_hundred_trials_each(tmp_path: Path) -> None:
    path = tmp_path / "log"
    writers = [spawn_writer(path, 200 * i, 200) for i in range(16)]
    assert [writer.communicate()[0].count("\n") for writer in writers] == [200] * 16
    with Journal(path) as journal:
        assert len(journal.records) == 3200
        assert all(journal.records[f"trial-{i}"] == {"objective": i / 7, "x": [i] * 20} for i in range(3200))


def kill_at_random(path: Path, kills: int, rng: np.random.Generator) -> None:
    """Kill writers of 400 records in mid-work until `kills` died; nothing acknowledged may be lost."""
    acknowledged: set[int] = set()
    died = 0
    while died < kills:
        writer = spawn_writer(path, len(acknowledged), 400)
        assert writer.stdout is not None
        acknowledged.add(int(writer.stdout.readline()))
        time.sleep(rng.uniform(0, 0.1))
        writer.kill()
        acknowledged |= {int(line) for line in writer.communicate()[0].split("\n")[:-1]}
        died += writer.returncode == -signal.SIGKILL
        with Journal(path) as journal:
            found = {int(key.removeprefix("trial-")) for key in journal.records}
            assert acknowledged <= found
            assert len(found - acknowledged) <= died
            assert all(journal.records[f"trial-{i}"] == {"objective": i / 7, "x": [i] * 20} for i in found)


def test_killed_writers_lose_nothing(tmp_path: Path) -> None:
    kill_at_random(tmp_path / "log", 5, np.random.default_rng(1))


@pytest.mark.slow
def test_a_hundred_killed_writers_lose_nothing(tmp_path: Path) -> None:
    kill_at_random(tmp_path / "log", 100, np.random.default_rng(2))


def filled(path: Path, n: int = 6) -> bytes:
    with Journal(path) as journal:
        for i in range(n):
            journal.append(f"k{i}", {"v": i / 3, "text": "é"})
    return path.read_bytes()


@pytest.mark.parametrize("cut", [1, 5, 40, 80, 100])
def test_an_incomplete_last_line_is_dropped_and_written_again(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "log"
    content = filled(path)
    path.write_bytes(content[:-cut])
    with Journal(path) as journal:
        assert list(journal.records) == [f"k{i}" for i in range(5)]
        journal.append("k5", {"v": 5 / 3, "text": "é"})
    assert path.read_bytes() == content


def test_zeros_after_a_power_cut_are_dropped(tmp_path: Path) -> None:
    path = tmp_path / "log"
    content = filled(path)
    path.write_bytes(content + bytes(512))
    with Journal(path) as journal:
        assert len(journal.records) == 6
    assert path.read_bytes() == content


@pytest.mark.parametrize("foreign", [b"\x80\x04K\x01.", b"[1, 2", b"PK\x03\x04", b"0123 5", bytes(9) + b"a"])
def test_a_foreign_file_is_no_incomplete_line(tmp_path: Path, foreign: bytes) -> None:
    path = tmp_path / "log"
    for content in (foreign, filled(path) + foreign):
        path.write_bytes(content)
        with pytest.raises(JournalError, match=r"damaged after [06] good records"):
            Journal(path)
        assert path.read_bytes() == content


def test_every_flipped_bit_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "log"
    content = filled(path)
    for position in range(len(content)):
        damaged = bytearray(content)
        damaged[position] ^= 1 << (position % 8)
        path.write_bytes(damaged)
        with pytest.raises(JournalError, match=r"damaged after [0-6] good records"):
            Journal(path)
        assert path.read_bytes() == damaged, "damage must be left as evidence"


@pytest.mark.parametrize("change", ["drop", "swap", "repeat", "foreign"])
def test_lines_that_are_lost_moved_repeated_or_foreign_are_noticed(tmp_path: Path, change: str) -> None:
    path = tmp_path / "log"
    lines = filled(path).splitlines(keepends=True)
    foreign = filled(tmp_path / "other", 3).splitlines(keepends=True)
    changed = {
        "drop": lines[:2] + lines[3:],
        "swap": [lines[0], lines[2], lines[1], *lines[3:]],
        "repeat": lines + lines[-1:],
        "foreign": lines + foreign[-1:],
    }[change]
    path.write_bytes(b"".join(changed))
    with pytest.raises(JournalError, match="damaged"):
        Journal(path)


def test_a_full_disk_is_reported_and_nothing_is_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log"
    content = filled(path)
    real = os.pwrite
    with Journal(path) as journal:

        def half_then_full(file: int, data: bytes, offset: int) -> int:
            if offset > len(content):
                raise OSError(errno.ENOSPC, "No space left on device")
            return real(file, data[: len(data) // 2], offset)

        monkeypatch.setattr(os, "pwrite", half_then_full)
        with pytest.raises(JournalError, match=r"cannot be written: No space left on device; what was ackno"):
            journal.append("k6", {"v": 1.0})
        assert path.read_bytes() == content
        monkeypatch.setattr(os, "pwrite", real)
        assert journal.append("k6", {"v": 1.0})
    with Journal(path) as journal:
        assert len(journal.records) == 7


def test_a_file_size_limit_of_the_system_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "log"
    limited = f"import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))\n{WRITER}"
    command = [sys.executable, "-c", limited, str(path), "0", "400"]
    writer = subprocess.run(command, capture_output=True, text=True)
    assert "JournalError" in writer.stderr
    assert "cannot be written: File too large" in writer.stderr
    acknowledged = len(writer.stdout.split())
    assert acknowledged > 5
    with Journal(path) as journal:
        assert len(journal.records) == acknowledged


def test_a_directory_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(JournalError, match="cannot be opened"):
        Journal(tmp_path / "file" / "log")
    with pytest.raises(JournalError, match="cannot be opened"):
        Journal(Path("/proc/no-such-place/log"))
    if os.geteuid() != 0:  # root may write everywhere
        (tmp_path / "closed").mkdir(mode=0o500)
        with pytest.raises(JournalError, match="cannot be opened: Permission denied"):
            Journal(tmp_path / "closed" / "log")


def test_only_finite_plain_data_and_plain_keys_are_taken(tmp_path: Path) -> None:
    with Journal(tmp_path / "log") as journal:
        for value in (float("nan"), float("inf")):
            with pytest.raises(ValueError, match="JSON compliant"):
                journal.append("k", {"v": value})
        for key in ("", "two words", "line\nbreak"):
            with pytest.raises(JournalError, match="without white space"):
                journal.append(key, 1)
        assert journal.records == {}
    assert (tmp_path / "log").read_bytes() == b""


def test_an_append_is_synced_before_it_returns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    events: list[str] = []
    real_write, real_sync = os.pwrite, os.fsync
    with Journal(tmp_path / "log") as journal:
        monkeypatch.setattr(os, "pwrite", lambda *a: (events.append("write"), real_write(*a))[1])
        monkeypatch.setattr(os, "fsync", lambda f: (events.append("sync"), real_sync(f))[1])
        journal.append("k", json.loads("[1]"))
    assert events == ["write", "sync"]
