"""Descriptions in and out, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from hdsafebo import Fixed, Limit, Objective, Real, System
from hdsafebo.system.errors import DescriptionError
from system.small import box_system, mixed_system


@pytest.mark.parametrize("name", ["s.yaml", "s.json"])
def test_files_give_the_system_back(name: str, tmp_path: Path) -> None:
    system = mixed_system()
    system.save(tmp_path / name)
    assert System.load(tmp_path / name) == system


def test_settings_may_be_a_csv_file_beside(tmp_path: Path) -> None:
    pd.DataFrame({"b": [1, 2], "a": [3.5, 4]}).to_csv(tmp_path / "rows.csv", index=False)
    data = box_system().to_dict() | {"settings": "rows.csv"}
    (tmp_path / "s.json").write_text(json.dumps(data))
    assert System.load(tmp_path / "s.json").settings == {"a": [3.5, 4.0], "b": [1, 2]}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"nmae": 1}, "nmae: unknown key"),
        ({"objective": None}, "objective: Input should be"),
        ({"limits": []}, "has no limits"),
        ({"limits": [{"name": "load"}]}, "limit 'load' has neither at_least nor at_most"),
        ({"limits": [{"name": "load", "at_least": 3, "at_most": 1}]}, "at_least 3 is not below at_most 1"),
        ({"limits": [{"name": "load", "at_most": 1, "noise": -1}]}, "noise of limit 'load' is -1"),
        ({"limits": [{"name": "gain", "at_most": 1}]}, "share the names 'gain'"),
        ({"objective": {"name": "gain", "direction": "max"}}, "objective.direction"),
        ({"parameters": [{"kind": "real", "name": "a", "lower": 0, "uper": 1}]}, "unknown key|is missing"),
        ({"parameters": [{"kind": "fixed", "name": "a", "value": 0}]}, "no parameter that can vary"),
        ({"constraints": ["a + b <= -1"]}, "no setting meets all"),
        ({"settings": {"a": [1, 2]}}, "settings have the columns a; expected a, b"),
        ({"settings": {"a": [1, 2], "b": [1]}}, "columns of \\[1, 2\\] rows"),
        ({"failures": "maybe"}, "failures"),
    ],
)
def test_bad_descriptions_are_named(change: dict, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        System.from_dict(box_system().to_dict() | change)


def test_a_context_is_no_column_of_the_settings() -> None:
    settings = {"a": [1.0], "b": [2.0], "load kg": [1.0]}
    with pytest.raises(
        DescriptionError, match="column 'load kg', which is a context: it is told with each ask"
    ):
        box_system(contexts=[Real("load kg", 0, 5)], settings=settings)
    with pytest.raises(DescriptionError, match="cannot be Fixed"):
        box_system(contexts=[Fixed("day", 1)])


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"parameters": ["a"]}, "parameters hold 'a'; expected Real, Integer, Choice or Fixed"),
        ({"limits": [Objective("x")]}, "limits hold .*; expected a Limit"),
        ({"objective": Limit("x", at_most=1)}, "expected an Objective"),
        ({"constraints": [3]}, "constraint 3; expected a Linear or a text"),
    ],
)
def test_parts_of_another_kind_are_named(parts: dict, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        box_system(**parts)


def test_files_that_are_no_description(tmp_path: Path) -> None:
    (tmp_path / "s.json").write_text("[1]")
    with pytest.raises(DescriptionError, match=r"s.json: expected an object"):
        System.load(tmp_path / "s.json")
    with pytest.raises(DescriptionError, match=r"nothing\.yaml"):
        System.load(tmp_path / "nothing.yaml")


def test_numpy_values_become_plain_ones() -> None:
    system = box_system(settings={"a": np.array([1.0, 2.0]), "b": np.array([3, 4])})
    json.dumps(system.to_dict(), allow_nan=False)
