"""Recordings from CSV files, as amplifiers' programs, R and pandas write them; pyarrow parses the numbers.

# session: ...            comments: labels, and `# annotation: SECONDS TEXT`
time_s,CHANNEL,...        header, cells quoted or not; units in brackets: Time [ms], IL_left (mV)
s,uV,...                  optional: a row of units
-0.05,1.5,...             rows; semicolons or tabs instead of commas, and then decimal commas, too
"""

from __future__ import annotations

import csv
import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.recording import (
    MAX_CHANNELS,
    MAX_VALUES,
    MICROVOLTS,
    Annotation,
    Channel,
    Recording,
    known_unit,
)
from hdsafebo.session.words import parse_number
from hdsafebo.typing import FloatArray

if TYPE_CHECKING:
    import pyarrow as pa

TIME_COLUMN = "time_s"
LABELS = ("session", "trial")
_ANNOTATION = "annotation"
_EXPECTED = f"expected {TIME_COLUMN},CHANNEL,..."
_SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "μs": 1e-6}
_TIME = re.compile(r"time(?:_(s|ms|us))?", re.IGNORECASE)
_DELIMITERS = ",;\t"
_MAX_PREAMBLE = 2**16  # bytes of comments, and of any line above the numbers
_BLOCK = 2**20  # bytes that are parsed at once; no line may be longer
_TIME_JITTER = 0.05  # of a sample: rounding of printed times


@dataclass(frozen=True)
class _Layout:
    """What stands above the numbers.

    Attributes:
        names, units: of each column; a unit that the file leaves out is None.
        time: which column holds the time.
        labels, annotations: from the comments.
        delimiter: between cells.
        start: where the numbers begin, in bytes.
        line: number of the line where they begin.
    """

    names: list[str]
    units: list[str | None]
    time: int
    labels: dict[str, str]
    annotations: list[Annotation]
    delimiter: str
    start: int
    line: int


def read_csv(
    content: bytes, name: str, unread: Collection[str] = (), sparse: Collection[str] = ()
) -> Recording:
    """Read a CSV recording; see the module.

    Args:
        content: of the file.
        name: of the file, for messages.
        unread: channels that are not looked at.
        sparse: channels where an empty cell is a zero: columns of marks are empty in between.

    Raises:
        RecordingError: malformed; the message names the line and the column.
    """
    layout = _layout(content, name)
    # Columns without a name are what R and pandas write in front of a table, and a delimiter at the end.
    wanted = [i for i, c in enumerate(layout.names) if i == layout.time or (c and c not in unread)]
    columns = _numbers(content, name, layout, wanted, sparse)
    time_s = columns.pop(layout.time) * _SECONDS[(layout.units[layout.time] or "s").casefold()]
    rate = _rate(time_s, content, name, layout)
    channels = tuple(
        Channel(layout.names[i], values, rate, float(time_s[0]), layout.units[i] or MICROVOLTS)
        for i, values in columns.items()
    )
    return Recording(name, channels, tuple(layout.annotations), layout.labels)


def _layout(content: bytes, name: str) -> _Layout:
    """Comments, header and units."""
    labels: dict[str, str] = {}
    annotations: list[Annotation] = []
    at, line = (3 if content.startswith(b"\xef\xbb\xbf") else 0), 1
    text, after = _line(content, at, name)
    while text.startswith("#") or (not text.strip() and after < len(content)):
        if after > _MAX_PREAMBLE:
            raise RecordingError(f"{name}: no header line in the first {_MAX_PREAMBLE} bytes, {_EXPECTED}")
        key, _, value = text[1:].partition(":")
        if key.strip() in LABELS:
            labels[key.strip()] = value.strip()
        elif key.strip() == _ANNOTATION:
            annotations.append(_annotation(value, f"{name}, line {line}"))
        at, line = after, line + 1
        text, after = _line(content, at, name)
    if not text.strip():
        raise RecordingError(f"{name}: no header line, {_EXPECTED}")
    delimiter = max(_DELIMITERS, key=lambda d: len(_cells(text, d)))
    header = [_name_and_unit(cell) for cell in _cells(text, delimiter)]
    if len(header) > MAX_CHANNELS:
        raise RecordingError(f"{name}: {len(header)} columns, expected at most {MAX_CHANNELS}")
    times = [i for i, (cell, _) in enumerate(header) if _TIME.fullmatch(cell)]
    if len(times) != 1 or len(header) < 2:
        raise RecordingError(f"{name}, line {line}: header is {text[:80]!r}, {_EXPECTED}")
    names, units = [cell for cell, _ in header], [unit for _, unit in header]
    time = times[0]
    found = _TIME.fullmatch(names[time])
    units[time] = units[time] or (found[1] if found else None)
    below, after_units = _line(content, after, name)
    row = [cell.strip("[]() ") for cell in _cells(below, delimiter)]
    if len(row) == len(names) and _is_units(row, time):
        units = [unit or cell or None for unit, cell in zip(units, row, strict=True)]
        after, line = after_units, line + 1
    if (units[time] or "s").casefold() not in _SECONDS:
        raise RecordingError(f"{name}: column {names[time]}: unit {units[time]!r}, expected s, ms or us")
    return _Layout(names, units, time, labels, annotations, delimiter, after, line + 1)


def _line(content: bytes, at: int, name: str) -> tuple[str, int]:
    """The line at a byte, and where the next one begins."""
    end = content.find(b"\n", at, at + _MAX_PREAMBLE)
    if end < 0:
        end = len(content)
    if end - at > _MAX_PREAMBLE:
        raise RecordingError(f"{name}: a line of more than {_MAX_PREAMBLE} bytes, {_EXPECTED}")
    raw = content[at:end].rstrip(b"\r")
    try:
        return raw.decode(), end + 1
    except UnicodeDecodeError as error:
        # Windows programs write "µV" in the code page of Western Europe.
        text = raw.decode("cp1252", errors="replace")
        if text.replace("\t", "").isprintable():
            return text, end + 1
        raise RecordingError(f"{name}: no UTF-8 text: {error.reason} at byte {at + error.start}") from None


def _cells(line: str, delimiter: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def _name_and_unit(cell: str) -> tuple[str, str | None]:
    """Name and unit of a header cell; what stands in brackets and is no known unit is part of the name."""
    for opening, closing in ("[]", "()"):
        if cell.endswith(closing):
            name, _, unit = cell[:-1].rpartition(opening)
            if name and (known_unit(unit) or unit.strip().casefold() in _SECONDS):
                return name.strip(), unit.strip()
    return cell, None


def _is_units(row: list[str], time: int) -> bool:
    """Whether a row below the header holds units: of the time, or of channels while the time has none."""
    return row[time].casefold() in _SECONDS or (not row[time] and any(map(known_unit, row)))


def _annotation(value: str, where: str) -> Annotation:
    time, _, text = value.strip().partition(" ")
    seconds = parse_number(time)
    if seconds is None:
        raise RecordingError(f"{where}: annotation at {time[:40]!r}, expected SECONDS TEXT")
    return Annotation(seconds, text.strip())


def _numbers(
    content: bytes, name: str, layout: _Layout, wanted: list[int], sparse: Collection[str]
) -> dict[int, FloatArray]:
    """The wanted columns, all finite and at least two rows long.

    The file is parsed in blocks, so that its size as numbers is known before there is room for it.
    """
    import pyarrow as pa
    import pyarrow.csv as pa_csv

    body = memoryview(content)[layout.start :]
    keys = [str(i) for i in range(len(layout.names))]
    comma = layout.delimiter != "," and re.search(rb"\d,\d|(?:^|[;\t\n]),\d", body) is not None
    batches: list[pa.RecordBatch] = []
    rows = 0
    try:
        reader = pa_csv.open_csv(
            pa.BufferReader(pa.py_buffer(body)),
            read_options=pa_csv.ReadOptions(use_threads=False, block_size=_BLOCK, column_names=keys),
            parse_options=pa_csv.ParseOptions(delimiter=layout.delimiter),
            convert_options=pa_csv.ConvertOptions(
                column_types=dict.fromkeys(keys, pa.float64()),
                include_columns=[keys[i] for i in wanted],
                null_values=[""],
                decimal_point="," if comma else ".",
                check_utf8=False,
            ),
        )
        for batch in reader:
            rows += batch.num_rows
            if rows * len(wanted) > MAX_VALUES:
                raise RecordingError(
                    f"{name}: more than {MAX_VALUES} values in {len(wanted)} columns, expected fewer: "
                    "record less, or list what is not needed in ignored_channels"
                )
            batches.append(batch)
    except pa.ArrowInvalid as error:
        raise RecordingError(_explained(str(error), content, name, layout)) from None
    if rows < 2:
        raise RecordingError(f"{name}: {rows} samples, expected at least 2")
    table = pa.Table.from_batches(batches)
    columns = {}
    for i in wanted:
        column = table.column(keys[i])
        if layout.names[i] in sparse:
            column = column.fill_null(0.0)
        columns[i] = _finite(column, i, content, name, layout)
    return columns


def _finite(column: pa.ChunkedArray, index: int, content: bytes, name: str, layout: _Layout) -> FloatArray:
    values = np.asarray(column.to_numpy(), float)  # an empty cell is NaN
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        at = _at(int(bad[0]), content, name, layout)
        cell = "is empty" if not column[int(bad[0])].is_valid else f"{values[bad[0]]}"
        raise RecordingError(f"{at}, column {layout.names[index]}: {cell}, expected a finite number")
    return values


def _explained(message: str, content: bytes, name: str, layout: _Layout) -> str:
    """What pyarrow says is wrong, with the line and the column of the file."""
    row = re.search(r"Row #(\d+)", message)
    at = name if row is None else _at(int(row[1]) - 1, content, name, layout)
    if value := re.search(r"In CSV column #(\d+): .*invalid value '(.*)", message, re.DOTALL):
        column, cell = layout.names[int(value[1])], value[2].rstrip("'").strip()
        return f"{at}, column {column}: {cell[:40]!r} is no number"
    if width := re.search(r"Expected (\d+) columns, got (\d+)", message):
        return f"{at}: {width[2]} values, expected {width[1]}"
    if "straddling" in message:
        return f"{name}: a line of more than {_BLOCK} bytes"
    if "Empty CSV file" in message:
        return f"{name}: 0 samples, expected at least 2"
    return f"{at}: no table of numbers: {message[:200]}"


def _at(row: int, content: bytes, name: str, layout: _Layout) -> str:
    """`FILE, line N` of a row of numbers; lines that are empty are no rows."""
    at, line, left = layout.start, layout.line, row
    while True:
        end = content.find(b"\n", at)
        empty = content[at:end] in (b"", b"\r")
        if end < 0 or (left == 0 and not empty):
            return f"{name}, line {line}"
        left -= not empty
        at, line = end + 1, line + 1


def _rate(time_s: FloatArray, content: bytes, name: str, layout: _Layout) -> float:
    """Sampling rate of times that increase evenly."""
    step = np.diff(time_s)
    back = np.flatnonzero(step <= 0)
    if len(back):
        raise RecordingError(
            f"{_at(int(back[0]) + 1, content, name, layout)}: times out of order: "
            f"{time_s[back[0] + 1]:g} s does not follow {time_s[back[0]]:g} s"
        )
    mean = float((time_s[-1] - time_s[0]) / len(step))
    even = time_s[0] + mean * np.arange(len(time_s))
    off = np.flatnonzero(np.abs(time_s - even) > _TIME_JITTER * mean + 1e-6)
    if len(off):
        raise RecordingError(
            f"{_at(int(off[0]), content, name, layout)}: samples are missing or the clock is uneven"
        )
    return 1.0 / mean
