"""The kept table of `benchmarks/outside.py`: constrained functions that others wrote."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hdsafebo.errors import DatasetError
from hdsafebo.files.bounded import read_text

IN_EVIDENCE = "benchmarks/outside/table.json"
OUTSIDE = f"reports/reference/{IN_EVIDENCE}"
_LABELS = {
    "ackley10": "Ackley, 10 inputs, 2 limits",
    "g04": "g04, 5 inputs, 6 limits",
    "g07": "g07, 10 inputs, 8 limits",
    "g09": "g09, 7 inputs, 4 limits",
    "gramacy_noisy": "Gramacy, 2 inputs, 2 limits, 1 % noise",
    "hartmann6": "Hartmann, 6 inputs, 1 limit",
    "hartmann6_noisy": "Hartmann, 6 inputs, 1 limit, 1 % noise",
    "keane30": "Keane's bump, 30 inputs, 2 limits",
    "pressure": "pressure vessel, 4 inputs, 4 limits",
    "speed": "speed reducer, 7 inputs, 11 limits",
    "tension": "tension spring, 3 inputs, 4 limits",
    "welded": "welded beam, 4 inputs, 6 limits",
}

Outside = dict[str, dict[str, dict[str, Any]]]


def read_outside(path: Path) -> Outside:
    """Problems by methods by measures: `best`, `safe`, `optimum`, `seeds`, ... (medians over seeds).

    Raises:
        DatasetError: the table is malformed.
    """
    try:
        table: Outside = json.loads(read_text(path))
        for methods in table.values():
            for row in methods.values():
                float(row["best"]), float(row["safe"]), float(row["optimum"]), int(row["seeds"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DatasetError(f"{path}: malformed: {type(error).__name__}: {error}") from error
    return table


def outside_label(problem: str) -> str:
    """Name of a problem with its size."""
    return _LABELS.get(problem, problem)


def is_close(row: dict[str, Any]) -> bool:
    """Whether the best safe value is within 1 % of the optimum."""
    return bool(abs(row["best"] - row["optimum"]) <= 0.01 * abs(row["optimum"]))
