"""A finished report is kept with the costs of its stages; an unfinished one is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hdsafebo.errors import DatasetError
from hdsafebo.pipeline.stage import COSTS_FILE
from hdsafebo.report.data.reference import COSTS, KEPT, keep_reference


def finished(root: Path) -> None:
    for name in KEPT:
        path = root / "reports" / name
        if Path(name).suffix:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps({"profile": "standard"}))
        else:
            path.mkdir(parents=True)
            (path / "part.csv").write_text("1")
    costs = [
        {"profile": "smoke", "stage": "report", "item": [], "seconds": 1.0, "peak_mb": 1},
        {"profile": "standard", "stage": "report", "item": [], "seconds": 2.0, "peak_mb": 1},
        {"profile": "standard", "stage": "report", "item": [], "seconds": 3.0, "peak_mb": 1},
    ]
    (root / COSTS).parent.mkdir()
    (root / COSTS).write_text("".join(json.dumps(cost) + "\n" for cost in costs))


def test_what_is_kept(tmp_path: Path) -> None:
    finished(tmp_path)
    folder = keep_reference(tmp_path)
    assert all((folder / name).exists() for name in KEPT)
    costs = json.loads((folder / "stage_costs.json").read_text())
    assert [cost["seconds"] for cost in costs] == [3.0]
    (tmp_path / "reports" / "tables" / "part.csv").unlink()
    assert not (keep_reference(tmp_path) / "tables" / "part.csv").exists()


def test_an_unfinished_report_is_refused(tmp_path: Path) -> None:
    finished(tmp_path)
    (tmp_path / "reports" / "summary.json").unlink()
    with pytest.raises(DatasetError, match=r"summary\.json missing"):
        keep_reference(tmp_path)


def test_costs_are_read_where_stages_write_them() -> None:
    assert COSTS == COSTS_FILE
