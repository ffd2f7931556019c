"""Tables that a user hands in, CSV or parquet: sizes are checked first, and errors name the line."""

from __future__ import annotations

import array
import csv
import io
import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hdsafebo.files.parquet import read_parquet
from hdsafebo.session.errors import RecordingError
from hdsafebo.session.words import parse_number
from hdsafebo.typing import FloatArray

if TYPE_CHECKING:
    import pyarrow as pa

MAX_BYTES = 64 * 2**20
MAX_CELLS = 4_000_000
MAX_ROWS = 2**18
_MAX_COLUMNS = 10_000
_MAX_LINES = 4 * MAX_ROWS  # empty ones among them
_MAX_LINE = 2**20  # characters
_CHUNK = 2**16  # cells that are kept as Python's texts, each some ten times as large as in the file
_CHUNK_LETTERS = 2**20


@dataclass(frozen=True)
class MeasuredTable:
    """Columns as they stand in the file: text (CSV), numbers or text (parquet).

    Attributes:
        source: file name, for messages.
        columns: header.
        cells: the columns, each in one piece; they take no more memory than the file.
        lines: line (CSV) or row (parquet) number of each row, for messages.
    """

    source: str
    columns: list[str]
    cells: list[pa.Array]
    lines: Sequence[int]

    def __len__(self) -> int:
        """How many rows."""
        return len(self.lines)

    def text(self, row: int, column: str) -> str:
        """A cell as text; empty where the value is missing."""
        value = self._value(row, column)
        return "" if value is None else str(value).strip()

    def number(self, row: int, column: str) -> float | None:
        """A finite number, or None where the cell is empty; RecordingError names the line otherwise."""
        value = self._value(row, column)
        if isinstance(value, int | float) and not isinstance(value, bool):
            number: float | None = float(value)
        else:
            text = self.text(row, column)
            if not text:
                return None
            number = parse_number(text)
        if number is None or not np.isfinite(number):
            raise RecordingError(f"{self.at(row)}, column {column}: {str(value)[:40]!r} is no finite number")
        return number

    def needed(self, row: int, column: str) -> float:
        """As `number`, but an empty cell is an error too."""
        value = self.number(row, column)
        if value is None:
            raise RecordingError(f"{self.at(row)}, column {column}: is empty, expected a number")
        return value

    def numbers(self, columns: Sequence[str]) -> FloatArray:
        """(rows, columns) finite numbers; RecordingError names the first cell that is none."""
        values = np.empty((len(self), len(columns)))
        for i, column in enumerate(columns):
            values[:, i] = [self.needed(row, column) for row in range(len(self))]
        return values

    def at(self, row: int) -> str:
        """`FILE, line N` of a row."""
        return f"{self.source}, line {self.lines[row]}"

    def require(self, columns: list[str], optional: list[str], most: int = MAX_ROWS) -> None:
        """RecordingError unless the table has exactly these columns, give or take the optional ones.

        Args:
            columns: the names, in any order.
            optional: further names.
            most: largest number of rows.
        """
        if len(self) > most:
            raise RecordingError(f"{self.source}: {len(self)} rows, expected at most {most}")
        missing = [c for c in columns if c not in self.columns]
        if missing:
            raise RecordingError(
                f"{self.source}: columns {', '.join(missing)} are missing; it has {', '.join(self.columns)}"
            )
        unknown = [c for c in self.columns if c not in columns and c not in optional]
        if unknown:
            raise RecordingError(
                f"{self.source}: columns {', '.join(unknown)} are unknown; expected {', '.join(columns)}"
            )

    def _value(self, row: int, column: str) -> Any:
        return self.cells[self._places[column]][row].as_py()

    @cached_property
    def _places(self) -> dict[str, int]:
        """Where each column stands."""
        return {column: i for i, column in enumerate(self.columns)}


def read_table(content: bytes, name: str) -> MeasuredTable:
    """Read a table; the suffix of `name` says whether it is `.csv` or `.parquet`.

    A CSV file may begin with comment lines (`#`), which are no part of the table.

    Raises:
        RecordingError: too large, another suffix, or malformed.
    """
    if len(content) > MAX_BYTES:
        raise RecordingError(f"{name}: {len(content)} bytes, expected at most {MAX_BYTES}")
    suffix = Path(name).suffix.lower()
    if suffix == ".csv":
        return _read_csv(content, name)
    if suffix == ".parquet":
        return _read_parquet(content, name)
    raise RecordingError(f"{name}: the name ends in {suffix or 'nothing'}, expected .csv or .parquet")


def _read_csv(content: bytes, name: str) -> MeasuredTable:
    """Rows are read one by one and kept as columns, so that no file becomes much larger in memory."""
    lines = array.array("l")
    columns: list[str] = []
    pieces: list[list[pa.Array]] = []
    waiting: list[list[str]] = []
    letters = 0
    try:
        for line, row in _rows(content, name):
            if not columns:
                columns = [c.strip() for c in row]
                _check_header(columns, name)
                continue
            if len(row) != len(columns):
                raise RecordingError(f"{name}, line {line}: {len(row)} values, expected {len(columns)}")
            lines.append(line)
            _check_size(len(lines), len(columns), name)
            waiting.append(row)
            letters += sum(map(len, row))
            if len(waiting) * len(columns) >= _CHUNK or letters >= _CHUNK_LETTERS:
                pieces.append(_columns(waiting, len(columns)))
                waiting, letters = [], 0
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{name}: no CSV file: {error}") from None
    if not columns:
        raise RecordingError(f"{name}: is empty, expected a header line")
    pieces.append(_columns(waiting, len(columns)))
    return MeasuredTable(name, columns, _joined(pieces), lines)


def _rows(content: bytes, name: str) -> Iterator[tuple[int, list[str]]]:
    """Every row that is not empty, after the comments, with the number of its last line."""
    lines = _lines(content, name)
    comments, first = 0, next(lines, "")
    while first.startswith("#"):
        comments, first = comments + 1, next(lines, "")
    reader = csv.reader(itertools.chain([first], lines), strict=True)
    for row in reader:
        if any(cell.strip() for cell in row):
            yield comments + reader.line_num, row


def _lines(content: bytes, name: str) -> Iterator[str]:
    """The lines of a text file; RecordingError when one is longer, or more of them, than a table has."""
    text = io.TextIOWrapper(io.BytesIO(content), encoding="utf-8-sig", newline="")
    for number in itertools.count(1):
        line = text.readline(_MAX_LINE + 1)
        if not line:
            return
        if len(line) > _MAX_LINE:
            raise RecordingError(f"{name}, line {number}: more than {_MAX_LINE} characters")
        if number > _MAX_LINES:
            raise RecordingError(f"{name}: more than {_MAX_LINES} lines")
        yield line


def _columns(rows: list[list[str]], width: int) -> list[pa.Array]:
    import pyarrow as pa

    return [pa.array([row[i] for row in rows], pa.string()) for i in range(width)]


def _joined(pieces: list[list[pa.Array]]) -> list[pa.Array]:
    """Each column in one piece; what has been joined is let go of."""
    import pyarrow as pa

    joined = []
    for i in range(len(pieces[0])):
        joined.append(pa.concat_arrays([piece[i] for piece in pieces]))
        for piece in pieces:
            piece[i] = None
    return joined


def _read_parquet(content: bytes, name: str) -> MeasuredTable:
    source = io.BytesIO(content)
    table = read_parquet(source, name, RecordingError, max_cells=MAX_CELLS, max_bytes=MAX_BYTES)
    columns = list(table.column_names)
    _check_header(columns, name)
    _check_size(table.num_rows, len(columns), name)
    cells = [table.column(c).combine_chunks() for c in columns]
    return MeasuredTable(name, columns, cells, range(1, table.num_rows + 1))


def _check_header(columns: list[str], name: str) -> None:
    if len(columns) > _MAX_COLUMNS:
        raise RecordingError(f"{name}: {len(columns)} columns, expected at most {_MAX_COLUMNS}")
    repeated = sorted(c for c, times in Counter(columns).items() if times > 1)
    if repeated:
        raise RecordingError(f"{name}: columns {', '.join(repeated)} appear twice")


def _check_size(rows: int, columns: int, name: str) -> None:
    if rows > MAX_ROWS:
        raise RecordingError(f"{name}: more than {MAX_ROWS} rows")
    if rows * columns > MAX_CELLS:
        raise RecordingError(f"{name}: more than {MAX_CELLS} cells")
