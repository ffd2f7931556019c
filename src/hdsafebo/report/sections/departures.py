"""Where this project differs from the paper, as a section of the page and as a document."""

from __future__ import annotations

import pandas as pd

from hdsafebo.report.data.departures import Departure, read_departures
from hdsafebo.report.sections.base import Section, Text
from hdsafebo.report.tables.results import Cell, Table

_INTRO = (
    "Everything that differs from the paper, or that the paper leaves open, in "
    "one place, with what it changes."
)
_COLUMNS = ["Where", "In the paper", "Here", "What it changes"]


def departures_section() -> Section:
    """The list as a table."""
    found = read_departures()
    rows = [[Cell(text, wide=True) for text in _texts(entry)] for entry in found]
    frame = pd.DataFrame([entry.model_dump() for entry in found])
    table = Table("departures", "Differences from the paper.", _COLUMNS, rows, frame)
    return Section("departures", "Departures from the paper", "", [Text(_INTRO), table])


def departures_markdown() -> str:
    """The list as `docs/departures.md`."""
    lines = ["# Departures from the paper", "", _INTRO, "The report page has the same list.", ""]
    for entry in read_departures():
        lines += [
            f"## {entry.where}",
            "",
            f"- **In the paper:** {entry.paper}",
            f"- **Here:** {entry.here}",
            f"- **What it changes:** {entry.changes}",
            "",
        ]
    return "\n".join(lines)


def _texts(entry: Departure) -> tuple[str, str, str, str]:
    return entry.where, entry.paper, entry.here, entry.changes
