"""Tables that a user hands in, CSV or parquet: sizes are checked first, and errors name the line."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

from hdsafebo.files.parquet import read_parquet
from hdsafebo.session.errors import RecordingError

MAX_BYTES = 64 * 2**20
MAX_CELLS = 5_000_000
_FIRST_CSV_LINE = 2  # line 1 is the header


@dataclass(frozen=True)
class Table:
    """Columns of text, as a CSV file would hold them.

    Attributes:
        source: file name, for messages.
        columns: header.
        rows: cells as text; empty where the value is missing.
        lines: line (CSV) or row (parquet) number of each row, for messages.
    """

    source: str
    columns: list[str]
    rows: list[list[str]]
    lines: list[int]

    def number(self, row: int, column: str) -> float | None:
        """A finite number, or None where the cell is empty; RecordingError names the line otherwise."""
        cell = self.rows[row][self.columns.index(column)].strip()
        if not cell:
            return None
        try:
            value = float(cell)
        except ValueError:
            value = float("nan")
        if not abs(value) < float("inf"):
            raise RecordingError(f"{self.at(row)}, column {column}: {cell[:40]!r} is no finite number")
        return value

    def needed(self, row: int, column: str) -> float:
        """As `number`, but an empty cell is an error too."""
        value = self.number(row, column)
        if value is None:
            raise RecordingError(f"{self.at(row)}, column {column}: is empty, expected a number")
        return value

    def at(self, row: int) -> str:
        """`FILE, line N` of a row."""
        return f"{self.source}, line {self.lines[row]}"

    def require(self, columns: list[str], optional: list[str]) -> None:
        """RecordingError unless the table has exactly these columns, give or take the optional ones."""
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


def read_table(content: bytes, name: str) -> Table:
    """Read a table; the suffix of `name` says whether it is `.csv` or `.parquet`.

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


def _read_csv(content: bytes, name: str) -> Table:
    try:
        reader = list(csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{name}: no CSV file: {error}") from None
    if not reader:
        raise RecordingError(f"{name}: is empty, expected a header line")
    columns = [c.strip() for c in reader[0]]
    _check_header(columns, name)
    numbered = [
        (line, row)
        for line, row in enumerate(reader[1:], start=_FIRST_CSV_LINE)
        if any(c.strip() for c in row)
    ]
    for line, row in numbered:
        if len(row) != len(columns):
            raise RecordingError(f"{name}, line {line}: {len(row)} values, expected {len(columns)}")
    return Table(name, columns, [row for _, row in numbered], [line for line, _ in numbered])


def _read_parquet(content: bytes, name: str) -> Table:
    table = read_parquet(io.BytesIO(content), name, RecordingError, max_cells=MAX_CELLS)
    columns, data = table.column_names, table.to_pydict()
    rows = [["" if data[c][i] is None else str(data[c][i]) for c in columns] for i in range(table.num_rows)]
    return Table(name, columns, rows, list(range(1, len(rows) + 1)))


def _check_header(columns: list[str], name: str) -> None:
    repeated = sorted({c for c in columns if columns.count(c) > 1})
    if repeated:
        raise RecordingError(f"{name}: columns {', '.join(repeated)} appear twice")
