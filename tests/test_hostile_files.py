"""Files that a user hands in, spoilt in every way at every entrance: a message each, and nothing executed."""

from __future__ import annotations

import gzip
import json
import os
import signal
import struct
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.entrances import ENTRANCES, refusal
from tests.spoiling import HOSTILE, cut, flipped

MEMORY_MB = 1500
_TAKEN = {  # what is no damage to the format: zeros and nothing are what a power cut leaves of a log
    ("journal", "nothing"),
    ("journal", "zeros"),
    ("second log of a session", "nothing"),  # it may be an entry behind, and this session has one
    ("second log of a session", "zeros"),
}
_OPENED_BY_PATH = (  # by the program itself, from a path that somebody hands in
    "params",
    "profile",
    "session file",
    "initial trials",
    "candidates",
    "log of a session",
    "second log of a session",
    "audit log",
    "optimiser state",
    "embedding",
    "embedding card",
    "run file",
    "synergies",
    "policy",
    "observations",
    "digits",
    "digit predictor",
    "lead field",
)
_GUARDED = ("lead field", "stimulation dataset")  # outs of the pipeline, whose every byte DVC checks


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project's directory, with room below it for what might climb out of an archive."""
    folder = tmp_path / "project"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def written(place: Path, name: str) -> tuple[Path, bytes]:
    """A valid file for an entrance."""
    entrance = ENTRANCES[name]
    path = place / entrance.name
    path.parent.mkdir(parents=True, exist_ok=True)
    entrance.write(path)
    return path, path.read_bytes()


def named(message: str, path: Path) -> bool:
    """Whether a message names the file; an embedding's card answers for its tensors."""
    return path.name in message or path.with_suffix(".json").name in message


@pytest.mark.parametrize("name", [n for n in ENTRANCES if n != "stimulation dataset"])  # 218,000 rows
def test_the_valid_file_is_taken(place: Path, name: str) -> None:
    path, _ = written(place, name)
    assert refusal(ENTRANCES[name], path) is None


@pytest.mark.parametrize("spoiling", HOSTILE)
@pytest.mark.parametrize("name", ENTRANCES)
def test_hostile_files_are_refused_by_name(place: Path, name: str, spoiling: str) -> None:
    path, valid = written(place, name)
    canary = place / "executed"
    path.write_bytes(HOSTILE[spoiling](valid, canary))
    before = {p for p in place.parent.rglob("*") if p.name != "__pycache__"}
    message = refusal(ENTRANCES[name], path)
    assert not canary.exists()
    if (name, spoiling) in _TAKEN:
        return
    assert message is not None
    assert named(message, path)
    assert "Traceback" not in message
    made = {p.name for p in place.parent.rglob("*") if p not in before}
    assert made == set()


@pytest.mark.parametrize("name", _OPENED_BY_PATH)
def test_a_pipe_is_refused_and_nobody_waits_for_it(place: Path, name: str) -> None:
    """Opening a pipe waits until somebody writes, and reading a device such as /dev/zero never ends."""
    path, _ = written(place, name)
    path.unlink()
    os.mkfifo(path)

    def too_long(number: int, frame: object) -> None:
        raise TimeoutError(f"{name} waits for a pipe")

    before = signal.signal(signal.SIGALRM, too_long)
    signal.alarm(20)
    try:
        message = refusal(ENTRANCES[name], path)
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    if name != "second log of a session":  # the first one has everything
        assert message is not None
        assert named(message, path)


@pytest.mark.parametrize("name", [n for n in ENTRANCES if n not in _GUARDED])
def test_cut_and_flipped_files_are_refused_or_read_as_they_are(place: Path, name: str) -> None:
    """A format without a checksum may take a flipped bit for a value; nothing may fail in another way."""
    path, valid = written(place, name)
    rng = np.random.default_rng(0)
    entrance = ENTRANCES[name]
    flips = [flipped(valid, rng) for _ in range(8)]
    for content in (*(cut(valid, share) for share in (0.1, 0.5, 0.9)), *flips):
        path.write_bytes(content)
        message = refusal(entrance, path)
        if message is None:
            assert entrance.unchecked or content in valid, "a changed byte went unnoticed"
        else:
            assert message


def _rows_bomb(path: Path, columns: Sequence[str] = ("original", "pca"), blocks: int = 30) -> None:
    """Run lengths: 60 million numbers in a quarter of a megabyte."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    block = pa.table({name: np.zeros(1_000_000) for name in columns})
    with pq.ParquetWriter(path, block.schema, compression="zstd") as writer:
        for _ in range(blocks):
            writer.write_table(block)


def _trials_bomb(path: Path) -> None:
    _rows_bomb(path, ("a", "b", "c", "speed", "economy", "margin"), blocks=1)


def _text_bomb(path: Path) -> None:
    """One long text that a dictionary repeats: 100 GB in 50 kB."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    text = pa.DictionaryArray.from_arrays(np.zeros(100_000, np.int32), pa.array(["x" * 1_000_000]))
    numbers = np.zeros(100_000)
    table = pa.table({"setting": text, "step": numbers, "total_reward": numbers})
    pq.write_table(table, path, store_schema=False)


def _tensor_bomb(path: Path) -> None:
    """A header that promises a tensor of 8 TB."""
    header = {"x": {"dtype": "F64", "shape": [10**6, 10**6], "data_offsets": [0, 8 * 10**12]}}
    text = json.dumps(header).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text)


def _header_bomb(path: Path) -> None:
    """A header of 2^62 bytes."""
    path.write_bytes(struct.pack("<Q", 2**62) + b"{" * 100)


def _gzip_bomb(path: Path) -> None:
    """Compressed zeros: a quarter of a gigabyte in one megabyte."""
    block = bytes(2**24)
    with gzip.open(path, "wb", compresslevel=1) as file:
        file.write(bytes((0, 0, 8, 3)) + struct.pack(">3I", 2**12, 256, 256))
        for _ in range(16):
            file.write(block)


def _laughs(path: Path) -> None:
    """A billion laughs."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 10)]
    path.write_text("\n".join(lines))


def _sparse(path: Path) -> None:
    """A terabyte that takes no room on the disk."""
    with path.open("wb") as file:
        file.truncate(2**40)


BOMBS: list[tuple[str, str, Callable[[Path], None], str]] = [
    ("distances", "", _rows_bomb, "60000000 cells, expected at most 50000000"),
    ("learning curve", "", _text_bomb, "100000000000 bytes of text, expected at most 1073741824"),
    ("initial parquet", "", _trials_bomb, "6000000 cells, expected at most 4000000"),
    ("optimiser state", "", _tensor_bomb, "not the state of an optimiser"),
    ("optimiser state", "", _header_bomb, "not the state of an optimiser"),
    ("optimiser state", "", _sparse, "1099511627776 bytes, expected at most"),
    ("embedding", "", _sparse, "1099511627776 bytes, expected at most"),
    ("embedding card", "", _sparse, "1099511627776 bytes, expected at most"),
    ("synergies", "", _tensor_bomb, "cannot be read as synergies"),
    ("synergies", "", _header_bomb, "cannot be read as synergies"),
    ("digits", ".gz", _gzip_bomb, "more than 200000000 bytes, expected an MNIST-sized file"),
    ("params", "", _laughs, "more than 100000 keys and values"),
    ("params", "", _sparse, "1099511627776 bytes, expected at most"),
    ("session file", "", _laughs, "more than 100000 keys and values"),
    ("session file", "", _sparse, "1099511627776 bytes, expected at most"),
    ("initial trials", "", _sparse, "1099511627776 bytes, expected at most"),
    ("profile", "", _laughs, "more than 100000 keys and values"),
]
# The peak of /proc begins anew with a program; that of getrusage begins with its parent's.
READER = """
import json, resource, sys
from pathlib import Path

def peak_mb():
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024

resource.setrlimit(resource.RLIMIT_AS, (12 << 30, 12 << 30))
from tests.entrances import ENTRANCES, refusal
for name, path in json.loads(sys.argv[1]):
    message = refusal(ENTRANCES[name], Path(path))
    print(json.dumps([message, peak_mb()]), flush=True)
"""


def test_files_that_would_become_huge_are_refused_in_bounded_memory(place: Path, project_root: Path) -> None:
    """One process reads them all; its largest memory is that of the imports and of the largest legal file."""
    jobs = []
    for number, (name, suffix, bomb, _) in enumerate(BOMBS):
        path, _valid = written(place / str(number), name)
        path.unlink()
        path = path.with_name(path.name + suffix)
        bomb(path)
        jobs.append((name, str(path)))
    environment = os.environ | {"PYTHONPATH": f"{project_root}{os.pathsep}{project_root / 'src'}"}
    command = [sys.executable, "-c", READER, json.dumps(jobs)]
    result = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert result.returncode == 0, result.stderr
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    assert len(lines) == len(BOMBS)
    for (name, _, bomb, expected), (message, memory_mb) in zip(BOMBS, lines, strict=True):
        assert message is not None, (name, bomb.__name__)
        assert expected in message
        assert memory_mb < MEMORY_MB, (name, bomb.__name__)
