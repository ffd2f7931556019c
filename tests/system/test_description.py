"""Descriptions in and out, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from hdsafebo import Choice, Fixed, Limit, Linear, Objective, Real, Study, System
from hdsafebo.system.description import read_settings
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


@pytest.mark.parametrize(
    "text", ['"1_0"', '"10"', "true", '"  5 "', '"nan"', "１", "[1]", "2024-01-01", ".inf", "1e400"]
)
@pytest.mark.parametrize("key", ["at_least", "noise"])
def test_text_and_truth_values_are_no_numbers_of_a_description(tmp_path: Path, text: str, key: str) -> None:
    """Python reads "1_0" as 10 and true as 1: a limit that nobody wrote."""
    path = tmp_path / "s.yaml"
    path.write_text(
        "name: s\nparameters: [{kind: real, name: a, lower: 0, upper: 1}]\nobjective: {name: y}\n"
        f"limits: [{{name: g, at_most: 99, {key}: {text}}}]\n"
    )
    with pytest.raises(DescriptionError, match=r"g|limits\.0"):
        System.load(path)


@pytest.mark.parametrize("key", ["name", "at_most"])
def test_a_key_twice_in_json_is_refused(tmp_path: Path, key: str) -> None:
    box_system().save(tmp_path / "s.json")
    text = (tmp_path / "s.json").read_text()
    (tmp_path / "s.json").write_text(text.replace(f'"{key}":', f'"{key}": 5, "{key}":', 1))
    with pytest.raises(DescriptionError, match=rf"s\.json.*key '{key}' appears twice"):
        System.load(tmp_path / "s.json")


@pytest.mark.parametrize("row", ["1,2,3", "1,2,3,4", "0,1,2"])
def test_rows_longer_than_their_header_do_not_move(tmp_path: Path, row: str) -> None:
    """pandas takes the first value for the label of the row, and every column is its neighbour's."""
    (tmp_path / "settings.csv").write_text(f"a,b\n{row}\n{row.replace('2', '3')}\n")
    with pytest.raises(DescriptionError, match=r"settings\.csv: cannot be read"):
        read_settings(tmp_path / "settings.csv")


@pytest.mark.parametrize(
    "make",
    [
        lambda: Real("a", 0, 10**400),
        lambda: Real("a", -1e308, 1e308),
        lambda: Fixed("a", 10**400),
        lambda: Limit("g", at_least=-(10**400)),
        lambda: Objective("y", noise=10**400),
        lambda: Linear.parse(f"a <= {10**400}"),
        lambda: Linear({"a": 10**400}, at_most=1),
    ],
)
def test_numbers_beyond_all_floats_are_refused_in_words(make: Callable[[], object]) -> None:
    with pytest.raises(DescriptionError):
        make()


@pytest.mark.parametrize(
    ("part", "name"),
    [
        ({"parameters": [Real("round", 0, 1)]}, "round"),
        ({"parameters": [Real("a", 0, 1)], "contexts": [Real("trial", 0, 1)]}, "trial"),
        ({"parameters": [Real("load_noise", 0, 1)]}, "load_noise"),
        ({"parameters": [Choice("status", ["completed", "failed"]), Real("a", 0, 1)]}, "status"),
        ({"limits": [Limit("safe", at_most=1)]}, "safe"),
        ({"limits": [Limit("load", at_most=1), Limit("gain_sd", at_most=1)]}, "gain_sd"),
        ({"limits": [Limit("load", at_most=1), Limit("load_safe", at_most=1)]}, "load_safe"),
        ({"limits": [Limit("completes", at_most=1)]}, "completes_safe"),
        ({"objective": Objective("safe_probability")}, "safe_probability"),
    ],
)
def test_no_name_is_that_of_another_column_of_the_tables(part: dict, name: str) -> None:
    """A parameter `round` was shown as the number of the round, an input `load_noise` was told as noise."""
    with pytest.raises(DescriptionError, match=f"two columns .* called '{name}'"):
        box_system(**part)


def test_values_of_numpy_are_choices_and_fixed_values_too() -> None:
    choice = Choice("pads", np.array([1, 2]))
    fixed = Fixed("gap", np.float32(0.5))
    assert (choice.values, fixed.value) == ((1, 2), 0.5)
    system = box_system(parameters=[choice, fixed, Choice("day", [np.str_("mon"), np.str_("tue")])])
    assert System.from_dict(json.loads(json.dumps(system.to_dict(), allow_nan=False))) == system


@pytest.mark.parametrize(
    "values", [[float("nan"), 1.0], [1.0, float("inf")], [1, 1.0], [0.0, -0.0], [1, "1"]]
)
def test_a_choice_can_be_written_and_read_back(values: list) -> None:
    """A description with NaN could not be written, and tables take 1 and 1.0 for one value."""
    with pytest.raises(DescriptionError, match="'a'"):
        Choice("a", values)


def test_a_choice_called_na_is_no_missing_value_of_a_list(tmp_path: Path) -> None:
    (tmp_path / "rows.csv").write_text("region,a\nNA,1\nNone,2\n")
    (tmp_path / "s.yaml").write_text(
        "name: s\nparameters:\n- {kind: choice, name: region, values: [NA, None]}\n"
        "- {kind: real, name: a, lower: 0, upper: 3}\nobjective: {name: y}\n"
        "limits: [{name: g, at_most: 9}]\nsettings: rows.csv\n"
    )
    study = Study(System.load(tmp_path / "s.yaml"))
    study.observe([{"region": "NA", "a": 1.0, "y": 1.0, "g": 1.0}])
    assert study.to_dataframe()["region"].tolist() == ["NA"]
