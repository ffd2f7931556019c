"""Edited parameters: taken, and then stable, or refused with a message that names the key."""

from __future__ import annotations

import copy
import datetime
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hdsafebo.cli import main
from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import read_mapping, write_mapping
from hdsafebo.pipeline.checked_params import load_checked_params, parse_checked_params

ROOT = Path(__file__).parents[2]
STANDARD = read_mapping(ROOT / "profiles" / "standard.yaml", ParamsError)
Key = str | int
Place = tuple[Key, ...]
Edit = tuple[str, Place, Any]


def places(value: Any, at: Place = ()) -> list[Place]:
    """Where every key and item is."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place for key, part in inner for place in ((*at, key), *places(part, (*at, key)))]


PLACES = places(STANDARD)
SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**70), 2**70),
    st.integers(-2, 20),
    st.floats(),
    st.floats(0, 1),
    st.text(max_size=12),
    st.sampled_from(
        ["1e-3", "yes", "null", "~", "hdsafebo", "../../etc/passwd", "a" * 5000, "${x}", "\x85", ""]
    ),
    st.dates(),
    st.datetimes(timezones=st.none() | st.just(datetime.UTC)),
    st.binary(max_size=4),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.text(max_size=6) | st.integers(-2, 2) | st.none() | st.dates(), inner, max_size=3
        )
    ),
    max_leaves=8,
)
EDITS = st.one_of(
    st.tuples(st.just("set"), st.sampled_from(PLACES), VALUES),
    st.tuples(st.just("set"), st.sampled_from(PLACES), SCALARS),
    st.tuples(st.just("delete"), st.sampled_from(PLACES), st.none()),
    st.tuples(st.just("add"), st.sampled_from(PLACES), st.text(min_size=1, max_size=8)),
    st.tuples(st.just("copy"), st.sampled_from(PLACES), st.sampled_from(PLACES)),
)


def at(data: Any, place: Place) -> Any:
    for key in place:
        data = data[key]
    return data


def edited(edits: list[Edit]) -> dict[str, Any]:
    """The standard parameters with changes; one whose place is gone by then changes nothing."""
    data = copy.deepcopy(STANDARD)
    for kind, place, value in edits:
        try:
            block = at(data, place[:-1])
            if kind == "delete":
                del block[place[-1]]
            elif kind == "add":
                at(data, place)[value] = 1
            elif kind == "copy":
                block[place[-1]] = copy.deepcopy(at(data, value))
            else:
                block[place[-1]] = value
        except (LookupError, TypeError):
            pass
    return data


def names_the_edit(message: str, edit: Edit) -> bool:
    """The key, its block, or a key of what was put in: a rule over several keys is reported by its block."""
    _, place, value = edit
    keys = [key for key in place if isinstance(key, str)]
    within = [repr(key) for key in value] if isinstance(value, dict) else []
    return any(key in message for key in [*keys[-2:], str(value), *within])


def check(path: Path, data: Any, edits: list[Edit], *, through_file: bool) -> bool:
    """Whether parameters are taken; fails unless they are then stable, or refused as they should be."""
    try:
        if through_file:
            write_mapping(path, data, ParamsError)
            params = load_checked_params(path)
        else:  # the same, but for the time that parsing the text takes
            params = parse_checked_params(data, source=str(path))
    except ParamsError as error:
        message = str(error)
        assert message.startswith(str(path))
        assert len(message) < 100_000
        assert len(edits) != 1 or names_the_edit(message, edits[0]), message
        return False
    plain = params.model_dump(mode="json")
    assert parse_checked_params(json.loads(json.dumps(plain))) == params
    return True


def mutate(path: Path, examples: int, *, derandomize: bool) -> list[bool]:
    taken: list[bool] = []

    @settings(
        max_examples=examples,
        derandomize=derandomize,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(st.lists(EDITS, min_size=1, max_size=3))
    def try_one(edits: list[Edit]) -> None:
        taken.append(check(path, edited(edits), edits, through_file=len(taken) % 5 == 0))

    try_one()
    return taken


@pytest.mark.thorough
def test_five_hundred_mutations(tmp_path: Path) -> None:
    taken = mutate(tmp_path / "params.yaml", 500, derandomize=True)
    assert len(taken) >= 500
    assert 10 < sum(taken) < len(taken) - 100, "the mutations should be of both kinds"


@pytest.mark.slow
def test_ten_thousand_mutations(tmp_path: Path) -> None:
    assert len(mutate(tmp_path / "params.yaml", 10_000, derandomize=False)) >= 10_000


LINES = (ROOT / "profiles" / "standard.yaml").read_text().splitlines()
ODD_LINES = [
    "\t",
    "- a",
    "? b",
    "  x: 1",
    "%YAML 1.2",
    "---",
    "...",
    "<<: {profile: x}",
    "a: &a 1",
    "b: *a",
    "'",
    ": :",
]
LINE_EDITS: dict[str, Callable[[list[str], int, str], None]] = {
    "remove": lambda lines, i, odd: lines.pop(i) and None,
    "indent": lambda lines, i, odd: lines.__setitem__(i, " " + lines[i]),
    "insert": lambda lines, i, odd: lines.insert(i, odd),
    "cut": lambda lines, i, odd: lines.__setitem__(i, lines[i][: len(lines[i]) // 2]),
    "append": lambda lines, i, odd: lines.__setitem__(i, lines[i] + odd),
}


@pytest.mark.thorough
def test_edited_lines_through_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 0, or 2 with one message; nothing else ever leaves `hdsafebo check-params`."""
    path = tmp_path / "params.yaml"
    codes: list[int] = []

    @settings(
        max_examples=50, derandomize=True, database=None, deadline=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(
        st.sampled_from(sorted(LINE_EDITS)),
        st.integers(0, len(LINES) - 1),
        st.sampled_from(ODD_LINES) | st.text(max_size=10),
    )
    def try_one(kind: str, line: int, odd: str) -> None:
        lines = list(LINES)
        LINE_EDITS[kind](lines, line, odd)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        try:
            main(["check-params", str(path)])
            codes.append(0)
        except SystemExit as end:
            codes.append(int(str(end.code)))
        printed = capsys.readouterr()
        assert str(path) in (printed.err if codes[-1] else printed.out)

    try_one()
    assert set(codes) == {0, 2}


@pytest.mark.thorough
def test_a_real_process_ends_with_code_2_and_no_traceback(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    write_mapping(path, edited([("set", ("tasks", "hand", "budget", "batch"), "ten")]), ParamsError)
    command = [sys.executable, "-m", "hdsafebo.cli", "check-params", str(path)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "tasks.hand.budget.batch" in result.stderr
    assert "'ten'" in result.stderr
    assert "Traceback" not in result.stderr
