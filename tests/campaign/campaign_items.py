"""Matrix items of the toys, and comparison of their files."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import campaign_toys as toys
import pyarrow as pa
import pyarrow.parquet as pq

from hdsafebo.campaign.item import run_item, run_path
from hdsafebo.params import parse_params
from hdsafebo.pipeline.tracking import Tracker
from hdsafebo.runs.schema import TIMES

Content = tuple[pa.Schema, dict[str, Any]]


class Recorder(Tracker):
    """Keeps what the mirror would be told."""

    def __init__(self, root: Path) -> None:
        super().__init__("optimize", {}, root, enabled=False)
        self.children: list[tuple[str, list[int], dict[str, list[float]]]] = []
        self.means: tuple[list[int], dict[str, list[float]]] = ([], {})

    def log_child(self, name: str, params: Any, steps: Any, series: Any) -> None:
        self.children.append((name, steps, series))

    def log_series(self, steps: Any, series: Any) -> None:
        self.means = steps, series


def compute(
    root: Path, *, where: dict[str, Any] | None = None, method: str = "toy", **sizes: Any
) -> Recorder:
    """Run the item of a toy method; `where` is the block `compute` of the parameters."""
    toys.toy_spec(root)  # makes the input file
    params = toys.toy_params(**({"seeds": 3, "trials": 60} | sizes)) | {"compute": where or {}}
    recorder = Recorder(root)
    run_item("synthetic", method, parse_params(params), root, recorder)
    return recorder


def without_times(root: Path) -> Content:
    """Schema with its metadata, and each column but the times, to the bit."""
    table = pq.read_table(run_path("synthetic", "toy", root)).combine_chunks()
    columns = {}
    for name in set(table.column_names) - set(TIMES):
        column = table[name].chunk(0).flatten() if name == "z" else table[name]
        if name == "status":
            columns[name] = column.to_pylist()
        else:
            columns[name] = column.to_numpy(zero_copy_only=False).tobytes()
    return table.schema, columns


def assert_same_file(one: Content, two: Content) -> None:
    """Equal in schema, metadata and every bit of the columns."""
    assert one[0].equals(two[0], check_metadata=True)
    assert one[1].keys() == two[1].keys()
    for name in one[1]:
        assert one[1][name] == two[1][name], name


def journalled(root: Path) -> int:
    """Bytes in the journals."""
    return sum(log.stat().st_size for log in root.glob(".journal/*/rounds.log"))


def wait_for(condition: Callable[[], Any], what: str, seconds: float = 120) -> None:
    """Wait until `condition()` is true; fail with `what` when it does not become so."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.01)


def environment() -> dict[str, str]:
    """For processes that import the toys."""
    here = str(Path(__file__).parent)
    return os.environ | {"PYTHONPATH": os.pathsep.join([here, os.environ.get("PYTHONPATH", "")])}
