"""The section of problems that others wrote."""

import json
from pathlib import Path

import pytest

from hdsafebo.errors import DatasetError
from hdsafebo.report.data.outside import OUTSIDE
from hdsafebo.report.results_page import growth_markdown, outside_markdown, wide_markdown
from hdsafebo.report.sections.base import Text
from hdsafebo.report.sections.outside import outside_section
from hdsafebo.report.tables.results import Table

ROW = {
    "seeds": 7,
    "optimum": -1.0,
    "best_50": -1.5,
    "best_50_range": [-2.0, -1.2],
    "best": -1.25,
    "best_range": [-1.5, -1.0],
    "safe": 0.99,
    "violation": 0.001,
    "near": 0.02,
    "marked": 0.0,
    "predicted": None,
    "cpu": 0.4,
}


def write(root: Path, content: str) -> None:
    path = root / OUTSIDE
    path.parent.mkdir(parents=True)
    path.write_text(content)


def test_every_problem_and_method_has_a_row(tmp_path: Path) -> None:
    write(tmp_path, json.dumps({"beam": {"hdsafebo_local": ROW, "qlognei": ROW | {"seeds": 2}}}))
    _, table = outside_section(tmp_path / OUTSIDE).blocks
    assert isinstance(table, Table)
    texts = [[cell.text for cell in row] for row in table.rows]
    assert [row[1] for row in texts] == ["HdSafeBO-local", "qLogNEI (BoTorch)"]
    assert texts[0][3] == "−1.25"
    assert texts[0][4:8] == ["0.990", "0.020", "0.000", "–"]
    assert table.frame["best_50"].tolist() == [-1.5, -1.5]


def test_without_a_table_the_section_says_so(tmp_path: Path) -> None:
    (block,) = outside_section(tmp_path / OUTSIDE).blocks
    assert isinstance(block, Text)
    assert block.kind == "missing"


@pytest.mark.parametrize("content", ["[", "[]", '{"beam": {"scbo": {}}}', '{"beam": 3}'])
def test_a_malformed_table_is_named(tmp_path: Path, content: str) -> None:
    write(tmp_path, content)
    with pytest.raises(DatasetError, match=r"table\.json: malformed"):
        outside_section(tmp_path / OUTSIDE)


def test_growth_is_shown_one_axis_at_a_time(tmp_path: Path) -> None:
    path = tmp_path / "constrained_time.json"
    assert growth_markdown(path) == "Not measured."
    sizes = [(50, 10, 4), (100, 10, 4), (100, 5, 4), (100, 10, 4), (100, 10, 1), (100, 10, 4)]
    rows = [
        {"trials": n, "dimension": d, "constraints": m, "cpu_s": n / 1000 + d / 100 + m} for n, d, m in sizes
    ]
    path.write_text(json.dumps(rows))
    assert growth_markdown(path).splitlines()[2:] == [
        "| known trials, with 10 inputs, 4 limits | 50: 4.15, 100: 4.20 |",
        "| inputs, with 100 known trials, 4 limits | 5: 4.15, 10: 4.20 |",
        "| limits, with 100 known trials, 10 inputs | 1: 1.20, 4: 4.20 |",
    ]


def test_wide_rounds_are_shown_with_their_units(tmp_path: Path) -> None:
    path = tmp_path / "wide_rounds.json"
    row = {"dimension": 63648, "trials": 1000, "round_cpu_s": 0.758, "peak_mb": 984.1, "state_mb": 41.3}
    path.write_text(json.dumps([row]))
    assert wide_markdown(path).splitlines()[-1] == "| 63,648 | 1,000 | 0.76 | 0.98 GB | 41 MB |"


def test_a_method_that_marks_nothing_has_a_dash(tmp_path: Path) -> None:
    path = tmp_path / "table.json"
    path.write_text(json.dumps({"pressure": {"qlognei": ROW | {"marked": None}}}))
    line = outside_markdown(path).splitlines()[-1]
    assert line.endswith("| `qlognei` | −1.2500 | 0.990 | – | 7 |")
