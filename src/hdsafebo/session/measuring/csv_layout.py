"""What stands above the numbers of a CSV recording: comments, header and units.

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

from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring.recording import MAX_CHANNELS, Annotation, known_unit, microvolts
from hdsafebo.session.words import parse_number

TIME_COLUMN = "time_s"
LABELS = ("session", "trial")
_ANNOTATION = "annotation"
_EXPECTED = f"expected {TIME_COLUMN},CHANNEL,..."
_SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "μs": 1e-6}
_TIME = re.compile(r"time(?:_(s|ms|us))?", re.IGNORECASE)
_DELIMITERS = ",;\t"
_MAX_PREAMBLE = 2**16  # bytes of comments, and of any line above the numbers


@dataclass(frozen=True)
class CsvLayout:
    """A CSV recording, and what stands above its numbers.

    Attributes:
        source: name of the file, for messages.
        content: of the file.
        names, units: of each column; a unit that the file leaves out is None.
        time: which column holds the time.
        labels, annotations: from the comments.
        delimiter: between cells.
        start: where the numbers begin, in bytes.
        line: number of the line where they begin.
    """

    source: str
    content: bytes
    names: list[str]
    units: list[str | None]
    time: int
    labels: dict[str, str]
    annotations: tuple[Annotation, ...]
    delimiter: str
    start: int
    line: int

    @property
    def second(self) -> float:
        """A unit of the time column, in s."""
        return _SECONDS[(self.units[self.time] or "s").casefold()]

    def place(self, row: int) -> str:
        """`FILE, line N` of a row of numbers, from 0; lines that are empty are no rows."""
        at, line, left = self.start, self.line, row
        while True:
            end = self.content.find(b"\n", at)
            empty = self.content[at:end] in (b"", b"\r")
            if end < 0 or (left == 0 and not empty):
                return f"{self.source}, line {line}"
            left -= not empty
            at, line = end + 1, line + 1


def read_layout(content: bytes, name: str, unread: Collection[str] = ()) -> CsvLayout:
    """Comments, header and units.

    Args:
        content: of the file.
        name: of the file, for messages.
        unread: columns that are not looked at; one of them may be called as a time is.

    Raises:
        RecordingError: no header with one time column, or an annotation without a time.
    """
    text, after, line, labels, annotations = _comments(content, name)
    where = f"{name}, line {line}"
    delimiter = max(_DELIMITERS, key=lambda d: len(_cells(text, d, where)))
    header = [_name_and_unit(cell) for cell in _cells(text, delimiter, where)]
    if len(header) > MAX_CHANNELS:
        raise RecordingError(f"{name}: {len(header)} columns, expected at most {MAX_CHANNELS}")
    names, units = [cell for cell, _ in header], [unit for _, unit in header]
    times = [
        (i, found) for i, cell in enumerate(names) if cell not in unread and (found := _TIME.fullmatch(cell))
    ]
    if len(times) != 1 or len(header) < 2:
        raise RecordingError(f"{where}: header is {text[:80]!r}, {_EXPECTED}")
    time, found = times[0]
    units[time] = units[time] or found[1]
    below, after_units = _line(content, after, name)
    row = [cell.strip("[]() ") for cell in _cells(below, delimiter, f"{name}, line {line + 1}")]
    if len(row) == len(names) and _is_units(row, time):
        _check_one_unit(names, units, row, f"{name}, line {line + 1}")
        units = [unit or cell or None for unit, cell in zip(units, row, strict=True)]
        after, line = after_units, line + 1
    return CsvLayout(
        name, content, names, units, time, labels, tuple(annotations), delimiter, after, line + 1
    )


def _comments(content: bytes, name: str) -> tuple[str, int, int, dict[str, str], list[Annotation]]:
    """The header line, where the next one begins, the header's number, and what the comments say."""
    labels: dict[str, str] = {}
    annotations: list[Annotation] = []
    after, line = (3 if content.startswith(b"\xef\xbb\xbf") else 0), 1
    text, after = _line(content, after, name)
    while text.startswith("#") or (not text.strip() and after < len(content)):
        if after > _MAX_PREAMBLE:
            raise RecordingError(f"{name}: no header line in the first {_MAX_PREAMBLE} bytes, {_EXPECTED}")
        key, _, value = text[1:].partition(":")
        if key.strip() in LABELS:
            labels[key.strip()] = value.strip()
        elif key.strip() == _ANNOTATION:
            annotations.append(_annotation(value, f"{name}, line {line}"))
        line += 1
        text, after = _line(content, after, name)
    if not text.strip():
        raise RecordingError(f"{name}: no header line, {_EXPECTED}")
    return text, after, line, labels, annotations


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


def _cells(line: str, delimiter: str, where: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:  # what the csv module says names modes of opening files
        raise RecordingError(
            f"{where}: no line of a table: it holds a carriage return without a line feed, or a cell of more "
            f"than {csv.field_size_limit()} characters; expected lines that end in a line feed"
        ) from None


def _check_one_unit(names: list[str], units: list[str | None], row: list[str], where: str) -> None:
    """RecordingError where the row of units says another one than the header: either may be the true one."""
    for name, unit, cell in zip(names, units, row, strict=True):
        if unit and cell and _meaning(unit) != _meaning(cell):
            raise RecordingError(f"{where}, column {name}: the unit is {cell!r}, in the header {unit!r}")


def _name_and_unit(cell: str) -> tuple[str, str | None]:
    """Name and unit of a header cell; what stands in brackets and is no known unit is part of the name."""
    for opening, closing in ("[]", "()"):
        if cell.endswith(closing):
            name, _, unit = cell[:-1].rpartition(opening)
            if name and (known_unit(unit) or unit.strip().casefold() in _SECONDS):
                return name.strip(), unit.strip()
    return cell, None


def _meaning(unit: str) -> object:
    """What tells units that are written in two ways from two units."""
    second, volt = _SECONDS.get(unit.casefold()), microvolts(unit)
    return ("s", second) if second is not None else ("uV", volt) if volt is not None else unit


def _is_units(row: list[str], time: int) -> bool:
    """Whether a row below the header holds units: of the time, or of channels while the time has none."""
    return row[time].casefold() in _SECONDS or (not row[time] and any(map(known_unit, row)))


def _annotation(value: str, where: str) -> Annotation:
    time, _, text = value.strip().partition(" ")
    seconds = parse_number(time)
    if seconds is None:
        raise RecordingError(f"{where}: annotation at {time[:40]!r}, expected SECONDS TEXT")
    return Annotation(seconds, text.strip())
