"""Recordings from CSV and EDF+ files. Nothing in them is trusted: size, header, every line is checked."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import numpy as np

from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.emg import Recording
from hdsafebo.typing import FloatArray

MAX_BYTES = 32 * 2**20
TIME_COLUMN = "time_s"
_LABELS = ("session", "trial")
_UNITS_UV = {"uv": 1.0, "µv": 1.0, "μv": 1.0, "mv": 1e3, "v": 1e6}
_TIME_JITTER = 0.05  # of a sample: rounding of printed times


def read_recording(content: bytes, name: str) -> Recording:
    """Read a recording; the suffix of `name` says whether it is `.csv` or `.edf`.

    Raises:
        RecordingError: too large, another suffix, or malformed; the message names the line or channel.
    """
    if len(content) > MAX_BYTES:
        raise RecordingError(f"{name}: {len(content)} bytes, expected at most {MAX_BYTES}")
    suffix = Path(name).suffix.lower()
    if suffix == ".csv":
        return _read_csv(content, name)
    if suffix == ".edf":
        return _read_edf(content, name)
    raise RecordingError(f"{name}: the name ends in {suffix or 'nothing'}, expected .csv or .edf")


def _read_csv(content: bytes, name: str) -> Recording:
    """Comment lines `# session: ...`, a header `time_s,CHANNEL,...`, then seconds and uV."""
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise RecordingError(f"{name}: no UTF-8 text: {error.reason} at byte {error.start}") from None
    labels: dict[str, str] = {}
    start = 0
    while start < len(lines) and lines[start].startswith("#"):
        key, _, value = lines[start][1:].partition(":")
        if key.strip() in _LABELS:
            labels[key.strip()] = value.strip()
        start += 1
    if start >= len(lines):
        raise RecordingError(f"{name}: no header line, expected {TIME_COLUMN},CHANNEL,...")
    header = [column.strip() for column in lines[start].split(",")]
    if header[0] != TIME_COLUMN or len(header) < 2:
        raise RecordingError(
            f"{name}, line {start + 1}: header is {lines[start][:80]!r}, expected {TIME_COLUMN},CHANNEL,..."
        )
    table = _table(lines[start + 1 :], name, first_line=start + 2, columns=header)
    rate = _rate(table[:, 0], name, first_line=start + 2)
    return Recording(name, tuple(header[1:]), rate, table[:, 1:], labels)


def _table(lines: list[str], name: str, first_line: int, columns: list[str]) -> FloatArray:
    """The numbers below the header, all finite, shape (n, columns)."""
    rows = []
    for number, line in enumerate(lines, start=first_line):
        if not line.strip():
            continue
        cells = line.split(",")
        if len(cells) != len(columns):
            raise RecordingError(f"{name}, line {number}: {len(cells)} values, expected {len(columns)}")
        try:
            rows.append([float(cell) for cell in cells])
        except ValueError:
            column, cell = _first_bad(cells, columns)
            raise RecordingError(f"{name}, line {number}, column {column}: {cell!r} is no number") from None
    if len(rows) < 2:
        raise RecordingError(f"{name}: {len(rows)} samples, expected at least 2")
    table = np.array(rows)
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        row, column_number = bad[0]
        line_number = [n for n, line in enumerate(lines, start=first_line) if line.strip()][row]
        raise RecordingError(
            f"{name}, line {line_number}, column {columns[column_number]}: "
            f"{table[row, column_number]}, expected a finite number"
        )
    return table


def _first_bad(cells: list[str], columns: list[str]) -> tuple[str, str]:
    for column, cell in zip(columns, cells, strict=True):
        try:
            float(cell)
        except ValueError:
            return column, cell.strip()[:40]
    raise AssertionError("called on a line of numbers")


def _rate(time_s: FloatArray, name: str, first_line: int) -> float:
    """Sampling rate of times that increase evenly."""
    step = np.diff(time_s)
    back = np.flatnonzero(step <= 0)
    if len(back):
        line = first_line + int(back[0]) + 1
        raise RecordingError(
            f"{name}, line {line}: times out of order: "
            f"{time_s[back[0] + 1]:g} s does not follow {time_s[back[0]]:g} s"
        )
    mean = float((time_s[-1] - time_s[0]) / len(step))
    even = time_s[0] + mean * np.arange(len(time_s))
    off = np.flatnonzero(np.abs(time_s - even) > _TIME_JITTER * mean + 1e-6)
    if len(off):
        raise RecordingError(
            f"{name}, line {first_line + int(off[0])}: samples are missing or the clock is uneven"
        )
    return 1.0 / mean


def _read_edf(content: bytes, name: str) -> Recording:
    """EDF or EDF+ (Kemp and Olivan 2003, Clin Neurophysiol 114:1755); annotations are left out."""
    import pyedflib

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.edf"
        path.write_bytes(content)
        try:
            with pyedflib.EdfReader(str(path)) as reader:
                channels = tuple(label.strip() for label in reader.getSignalLabels())
                if not channels:
                    raise RecordingError(f"{name}: no signals")
                rates = [float(rate) for rate in reader.getSampleFrequencies()]
                if len(set(rates)) > 1:
                    listed = ", ".join(f"{c} {r:g} Hz" for c, r in zip(channels, rates, strict=True))
                    raise RecordingError(f"{name}: channels differ in rate ({listed}), expected one rate")
                scale = [_unit(reader.getPhysicalDimension(i), c, name) for i, c in enumerate(channels)]
                samples = np.stack([reader.readSignal(i) * s for i, s in enumerate(scale)], axis=1)
                note = str(reader.getRecordingAdditional())
        except (OSError, ValueError) as error:
            raise RecordingError(f"{name}: no valid EDF file: {' '.join(str(error).split())}") from None
    labels = {key: found.group(1) for key in _LABELS if (found := re.search(rf"\b{key}=([^\s;]+)", note))}
    return Recording(name, channels, rates[0], samples, labels)


def _unit(dimension: str, channel: str, name: str) -> float:
    factor = _UNITS_UV.get(dimension.strip().lower())
    if factor is None:
        raise RecordingError(f"{name}: channel {channel}: unit {dimension.strip()!r}, expected uV, mV or V")
    return factor
