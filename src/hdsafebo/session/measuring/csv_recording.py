"""Recordings from CSV files, as amplifiers' programs, R and pandas write them; pyarrow parses the numbers."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.csv_layout import CsvLayout, read_layout
from hdsafebo.session.measuring.recording import MAX_VALUES, MICROVOLTS, Channel, Recording
from hdsafebo.typing import FloatArray

if TYPE_CHECKING:
    import pyarrow as pa

_BLOCK = 2**20  # bytes that are parsed at once; no line may be longer
_DECIMAL_COMMA = re.compile(rb"\d,\d|(?:^|[;\t\n]),\d")
_TIME_JITTER = 0.05  # of a sample: rounding of printed times


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
    layout = read_layout(content, name, unread)
    # Columns without a name are what R and pandas write in front of a table, and a delimiter at the end.
    wanted = [i for i, c in enumerate(layout.names) if i == layout.time or (c and c not in unread)]
    columns = _read_numbers(layout, wanted, sparse)
    time_s = columns.pop(layout.time) * layout.second
    rate = _rate(time_s, layout)
    channels = tuple(
        Channel(layout.names[i], values, rate, float(time_s[0]), layout.units[i] or MICROVOLTS)
        for i, values in columns.items()
    )
    return Recording(name, channels, layout.annotations, layout.labels)


def _read_numbers(layout: CsvLayout, wanted: list[int], sparse: Collection[str]) -> dict[int, FloatArray]:
    """The wanted columns, with decimal points or, where these make no numbers of them, decimal commas.

    A comma in a column that nobody looks at says nothing about the others.
    """
    try:
        return _numbers(layout, wanted, sparse, ".")
    except RecordingError:
        if layout.delimiter == "," or not _DECIMAL_COMMA.search(layout.content, layout.start):
            raise
    return _numbers(layout, wanted, sparse, ",")


def _numbers(
    layout: CsvLayout, wanted: list[int], sparse: Collection[str], decimal_point: str
) -> dict[int, FloatArray]:
    """The wanted columns, all finite and at least two rows long.

    The file is parsed in blocks, so that no more of it becomes numbers than there is room for.
    """
    import pyarrow as pa
    import pyarrow.csv as pa_csv

    body = memoryview(layout.content)[layout.start :]
    keys = [str(i) for i in range(len(layout.names))]
    pieces: dict[int, list[FloatArray]] = {i: [] for i in wanted}
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
                decimal_point=decimal_point,
                check_utf8=False,
            ),
        )
        for batch in reader:
            for i, column in zip(wanted, batch.columns, strict=True):
                zero = layout.names[i] in sparse
                pieces[i].append(_finite(column.fill_null(0.0) if zero else column, i, rows, layout))
            rows += batch.num_rows
            if rows * len(wanted) > MAX_VALUES:
                raise RecordingError(
                    f"{layout.source}: more than {MAX_VALUES} values in {len(wanted)} columns, expected "
                    "fewer: record less, or list what is not needed in ignored_channels"
                )
    except pa.ArrowInvalid as error:
        raise RecordingError(_explained(str(error), layout)) from None
    if rows < 2:
        raise RecordingError(f"{layout.source}: {rows} samples, expected at least 2")
    return {i: np.concatenate(pieces.pop(i)) for i in wanted}


def _finite(column: pa.Array, index: int, rows: int, layout: CsvLayout) -> FloatArray:
    """Numbers of a part of a column that follows so many rows."""
    values = np.array(column.to_numpy(zero_copy_only=False), float)  # an empty cell is NaN
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        cell = f"{values[bad[0]]}" if column[int(bad[0])].is_valid else "is empty"
        at = layout.place(rows + int(bad[0]))
        raise RecordingError(f"{at}, column {layout.names[index]}: {cell}, expected a finite number")
    return values


def _explained(message: str, layout: CsvLayout) -> str:
    """What pyarrow says is wrong, with the line and the column of the file."""
    row = re.search(r"Row #(\d+)", message)
    at = layout.source if row is None else layout.place(int(row[1]) - 1)
    if value := re.search(r"In CSV column #(\d+): .*invalid value '(.*)", message, re.DOTALL):
        column, cell = layout.names[int(value[1])], value[2].rstrip("'").strip()
        return f"{at}, column {column}: {cell[:40]!r} is no number"
    if width := re.search(r"Expected (\d+) columns, got (\d+)", message):
        return f"{at}: {width[2]} values, expected {width[1]}"
    if "straddling" in message:
        return f"{layout.source}: a line of more than {_BLOCK} bytes"
    if "Empty CSV file" in message:
        return f"{layout.source}: 0 samples, expected at least 2"
    return f"{at}: no table of numbers: {message[:200]}"


def _rate(time_s: FloatArray, layout: CsvLayout) -> float:
    """Sampling rate of times that increase evenly."""
    step = np.diff(time_s)
    back = np.flatnonzero(step <= 0)
    if len(back):
        raise RecordingError(
            f"{layout.place(int(back[0]) + 1)}: times out of order: "
            f"{time_s[back[0] + 1]:g} s does not follow {time_s[back[0]]:g} s"
        )
    mean = float((time_s[-1] - time_s[0]) / len(step))
    even = time_s[0] + mean * np.arange(len(time_s))
    off = np.flatnonzero(np.abs(time_s - even) > _TIME_JITTER * mean + 1e-6)
    if len(off):
        raise RecordingError(f"{layout.place(int(off[0]))}: samples are missing or the clock is uneven")
    return 1.0 / mean
