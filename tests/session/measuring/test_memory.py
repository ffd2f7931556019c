"""Whatever is handed in, reading it takes at most four times the largest size that such a file may have."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from hdsafebo.session.measuring import recording, tables
from tests.session.measuring.edf_files import EdfFile, Signal
from tests.session.small import small_definition

MUSCLES = small_definition()["emg"]["muscles"]


def csv_of_ones(size: int) -> bytes:
    """As many numbers as fit: two bytes each."""
    row = ",".join("1" * 9) + "\n"
    return f"time_s,{','.join(MUSCLES)}\n".encode() + row.encode() * (size // len(row) - 10)


def csv_of_a_recording(size: int) -> bytes:
    """A recording that is as long as it may be, and read whole."""
    noise = np.random.default_rng(0).normal(0, 20, (2000, 8))
    rows = min(size // 80, recording.MAX_VALUES // 9)
    cells = [",".join(f"{v:.3f}" for v in row) for row in noise.tolist()]
    body = "\n".join(f"{i / 2000:.4f},{cells[i % 2000]}" for i in range(rows))
    return f"time_s,{','.join(MUSCLES)}\n{body}\n".encode()


def csv_of_one_muscle(size: int) -> bytes:
    return b"time_s,IL_left\n" + b"0,1\n" * (size // 4 - 10)


def edf_of_noise(size: int, bdf: bool, records: int) -> bytes:
    """As many samples of the muscles as may be read, and an ignored channel that fills the file."""
    rng = np.random.default_rng(0)
    limit = 2 ** (23 if bdf else 15)
    each = (size - 4000) // (3 if bdf else 2) // records
    used = min(each // 9, recording.MAX_VALUES // 8 // records)
    signals = [Signal(m, rng.integers(-limit // 2, limit // 2, (records, used))) for m in MUSCLES]
    filler = Signal("AUX", np.zeros((records, each - used * 8), int))
    return EdfFile([*signals, filler], bdf=bdf, duration=f"{used / 2000:.6f}"[:8]).to_bytes()


def edf_of_texts(size: int) -> bytes:
    """Nothing but annotations."""
    signal = Signal(MUSCLES[0], np.zeros((20, 1), int))
    notes = [f"+{i}\x14a" for i in range(size // 20 // 12)]
    stamps = [f"+{i}" for i in range(20)]
    return EdfFile(
        [signal], reserved="EDF+C", stamps=stamps, annotations=dict.fromkeys(range(20), notes)
    ).to_bytes()


def edf_of_empty_texts(size: int) -> bytes:
    signal = Signal(MUSCLES[0], np.zeros((20, 1), int))
    return EdfFile(
        [signal], reserved="EDF+C", stamps=[f"+{i}" + "\x14\x14\x00" * (size // 70) for i in range(20)]
    ).to_bytes()


RECORDINGS: dict[str, tuple[str, Callable[[int], bytes]]] = {
    "csv_ones": ("csv", csv_of_ones),
    "csv_recording": ("csv", csv_of_a_recording),
    "csv_one_muscle": ("csv", csv_of_one_muscle),
    "csv_newlines": ("csv", lambda size: b"time_s,IL_left\n" + b"\n" * (size - 100)),
    "csv_comments": ("csv", lambda size: b"#\n" * (size // 2)),
    "csv_one_line": ("csv", lambda size: b"time_s," + b"1" * (size - 100)),
    "csv_columns": ("csv", lambda size: b"time_s" + b",a" * 500 + b"\n" + b"0,1\n" * (size // 5)),
    "edf": ("edf", lambda size: edf_of_noise(size, False, 16)),
    "bdf": ("bdf", lambda size: edf_of_noise(size, True, 16)),
    "bdf_long_records": ("bdf", lambda size: edf_of_noise(size, True, 1)),
    "edf_texts": ("edf", edf_of_texts),
    "edf_empty_texts": ("edf", edf_of_empty_texts),
}


def candidates(size: int) -> bytes:
    """As many rows as a list may have, all different."""
    i = np.arange(tables.MAX_ROWS)
    rows = "\n".join(f"0.{n:08d},0.5,0.1" for n in i)
    return f"a,b,c\n{rows}\n".encode()


def parquet_of_runs(size: int) -> bytes:
    """A few kilobytes that stand for as many cells as are allowed."""
    buffer = io.BytesIO()
    column = pa.array(np.zeros(tables.MAX_ROWS))
    pq.write_table(pa.table(dict.fromkeys("abc", column)), buffer, compression="zstd")
    return buffer.getvalue()


def parquet_of_long_texts(size: int) -> bytes:
    """One text of a megabyte, 100,000 times."""
    buffer = io.BytesIO()
    text = pa.DictionaryArray.from_arrays(pa.array(np.zeros(100_000, np.int32)), pa.array(["x" * 2**20]))
    pq.write_table(pa.table({"a": text}), buffer, compression="zstd")
    return buffer.getvalue()


TABLES: dict[str, tuple[str, str, Callable[[int], bytes]]] = {
    "newlines": ("initial", "csv", lambda size: b"a,b,c,speed,economy,margin\n" + b"\n" * (size - 100)),
    "commas": ("initial", "csv", lambda size: b"," * (size - 100)),
    "rows": (
        "initial",
        "csv",
        lambda size: b"a,b,c,speed,economy,margin\n" + b"0.5,0.5,0,1,1,1\n" * (size // 16 - 9),
    ),
    "single_cells": ("initial", "csv", lambda size: b"a\n" + b"1\n" * (size // 2 - 9)),
    "emoji": ("initial", "csv", lambda size: b"a\n" + ("😀" * 10_000 + "\n").encode() * (size // 40_001 - 9)),
    "one_cell": ("initial", "csv", lambda size: b"a\n" + b"1" * (size - 100)),
    "candidates": ("candidates", "csv", candidates),
    "runs": ("initial", "parquet", parquet_of_runs),
    "long_texts": ("initial", "parquet", parquet_of_long_texts),
}


def measured(small: Path, files: list[tuple[Path, str]]) -> list[dict[str, Any]]:
    """Bytes that reading each file took, and what was said about it."""
    command = [sys.executable, "-m", "tests.session.measuring.memory", str(small)]
    command += [text for path, kind in files for text in (str(path), kind)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=800)
    assert done.returncode == 0, done.stderr[-2000:]
    results = [json.loads(line) for line in done.stdout.splitlines()]
    for r in results:
        print(f"{r['bytes'] / 2**20:.0f} MiB, {r['seconds']:.1f} s: {r['name']}: {r['said']}")
    assert [r["name"] for r in results] == [path.stem for path, _ in files]
    return results


def test_a_recording_takes_four_times_its_largest_size_at_most(tmp_path: Path) -> None:
    files = []
    for name, (suffix, make) in RECORDINGS.items():
        path = tmp_path / f"{name}.{suffix}"
        path.write_bytes(make(recording.MAX_BYTES))
        assert path.stat().st_size <= recording.MAX_BYTES
        files.append((path, "recording"))
    small = tmp_path / "small.csv"
    small.write_bytes(csv_of_a_recording(200_000))
    for result in measured(small, files):
        assert result["bytes"] <= 4 * recording.MAX_BYTES, result
        whole = result["name"].endswith(("recording", "edf", "bdf"))
        assert whole == (result["said"] == "read"), result


def test_a_table_takes_four_times_its_largest_size_at_most(tmp_path: Path) -> None:
    files = []
    for name, (kind, suffix, make) in TABLES.items():
        path = tmp_path / f"{name}.{suffix}"
        path.write_bytes(make(tables.MAX_BYTES))
        assert path.stat().st_size <= tables.MAX_BYTES
        files.append((path, kind))
    small = tmp_path / "small.csv"
    small.write_bytes(b"a,b,c,speed,economy,margin\n0.5,0.5,0,1,1,1\n")
    for result in measured(small, files):
        assert result["bytes"] <= 4 * tables.MAX_BYTES, result
        assert (result["name"] == "candidates") == (result["said"] == "read"), result
