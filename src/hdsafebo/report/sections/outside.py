"""Problems that others wrote: what every method reaches by its defaults (`benchmarks/outside.py`)."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from hdsafebo.errors import DatasetError
from hdsafebo.report.data.methods import style
from hdsafebo.report.data.outside import Outside, read_outside
from hdsafebo.report.formatting import number
from hdsafebo.report.sections.base import Section, Text, not_run
from hdsafebo.report.tables.results import Cell, Table

_SHARES = {"safe": "safe", "near": "near-duplicates", "marked": "marked", "predicted": "predicted safe"}
_INTRO = (
    "Constrained functions of BoTorch and of the CEC 2006 collection, two of them seen through noise; "
    "batches of five, 100 trials (150 in 30 dimensions), the same initial data and every method's defaults. "
    "Trials are judged by the true functions. The local method was developed on the first seven with other "
    "seeds. Best: median of the best safe objective over seeds, and its range."
)


def outside_section(path: Path) -> Section:
    """From the kept table of the benchmark.

    Args:
        path: of the table.

    Raises:
        DatasetError: the table is malformed.
    """
    title = "Problems that others wrote"
    if not path.is_file():
        return Section("outside", title, "", [not_run(title)])
    problems = read_outside(path)
    try:
        return Section("outside", title, "", [Text(_INTRO), _table(problems)])
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DatasetError(f"{path}: malformed: {type(error).__name__}: {error}") from error


def _table(problems: Outside) -> Table:
    """Problems by methods."""
    rows, records = [], []
    for problem, methods in problems.items():
        for method, row in methods.items():
            label = "qLogNEI (BoTorch)" if method == "qlognei" else style(method).label
            low, high = row["best_range"]
            cells = [
                Cell(problem, f"optimum {number(row['optimum'])}"),
                Cell(label, f"{row['seeds']} seeds"),
                Cell(number(row["best_50"])),
                Cell(number(row["best"]), f"{number(low)} to {number(high)}"),
                *(Cell("–" if row[key] is None else f"{row[key]:.3f}") for key in _SHARES),
                Cell(number(row["violation"])),
                Cell(number(row["cpu"])),
            ]
            rows.append(cells)
            records.append({"problem": problem, "method": method} | row | {"best_range": f"{low} {high}"})
    columns = ["Problem", "Method", "Best at 50", "Best at the end", *_SHARES.values(), "violation", "CPU s"]
    caption = "CPU: seconds per 10 trials on a shared machine. Violation: in medians of the box's violations."
    return Table("outside", caption, columns, rows, pd.DataFrame(records))
