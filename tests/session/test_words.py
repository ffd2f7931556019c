"""Names and numbers are read in one way, whatever way they come in."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hdsafebo.session import cli
from hdsafebo.session.errors import LimitError, ProtocolError
from hdsafebo.session.session import Session
from hdsafebo.session.words import (
    checked_name,
    checked_text,
    parse_assignments,
    parse_json,
    parse_number,
    parse_whole_number,
    shown,
    trimmed_text,
)

NO_NUMBERS = ["", " ", "1_200", "1 200", "1,5", "0x10", "nan", "inf", "-inf", "infinity", "1e999", "٣", "½"]
NO_NUMBERS += ["1e", "--1", "0.1mA", "0.1mA5", "1.2.3", "e5", ".", "+", "1\n", " 1"]
HIDDEN = ["\x00", "\x1b", "\x9b", "\u202e", "\u2066", "\u200b", "\ufeff", "\u2028", "\ud800"]


@pytest.mark.parametrize("text", NO_NUMBERS)
def test_what_is_no_plain_number(text: str) -> None:
    assert parse_number(text) is None
    assert parse_whole_number(text) is None
    with pytest.raises(ProtocolError):
        parse_assignments([f"a={text}"])


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_number_that_python_writes_is_read_back(number: float) -> None:
    assert parse_number(repr(number)) == number
    assert parse_assignments([f"a={number!r}"]) == {"a": number}


def test_a_name_that_is_given_twice_is_refused_at_every_entrance() -> None:
    with pytest.raises(ProtocolError, match=r"a is given twice, 0\.5 before"):
        parse_assignments(["a=0.5", "b=1", "a=0.6"])
    for text in ('{"a": 1, "a": 2}', '{"x": {"a": 1, "a": 1}}', "[NaN]", "[Infinity]", "[" * 100_000, "{"):
        with pytest.raises(ProtocolError, match="every name once"):
            parse_json(text.encode())


@pytest.mark.parametrize(
    "text",
    ["a=0.5 a=0.6", "a=1_0", "a=0.5 b=nan", "a=0.5 b=inf", "a", "=1", "a=", "d=0.5", "a=0.5,b=0.5", "a==1"],
)
def test_points_of_a_box_are_read_by_the_same_reader(make_session: object, text: str) -> None:
    session: Session = make_session()  # type: ignore[operator]
    base = {"values": [0.5, 0.5, 0.0]}
    with pytest.raises(LimitError):
        session.space.parse(text, base)


@settings(max_examples=50)
@given(st.text())
def test_what_is_taken_can_be_shown_in_one_line(text: str) -> None:
    try:
        name = checked_name(text)
    except ProtocolError:
        return
    assert name == shown(name)
    assert name == checked_name(name)
    assert 0 < len(name) <= 100


@pytest.mark.parametrize("hidden", HIDDEN)
def test_characters_that_nobody_sees_are_refused_and_written_out(hidden: str) -> None:
    for check in (checked_name, lambda t: checked_text(t, "note")):
        with pytest.raises(ProtocolError, match="control characters"):
            check(f"a{hidden}b")
    assert hidden not in shown(f"a{hidden}b")
    assert trimmed_text(f"a{hidden}b", 10, "none") == "ab"


def test_a_note_may_have_lines_and_a_name_may_not() -> None:
    assert checked_text("one\ntwo\tthree", "note") == "one\ntwo\tthree"
    with pytest.raises(ProtocolError, match="line break"):
        checked_name("ann\nbob")
    assert checked_name("  Zoë ") == "Zo\u00eb"
    assert checked_name("Zoe\u0308") == "Zo\u00eb"


def test_the_command_line_has_no_reader_of_numbers_of_its_own() -> None:
    """`float` and `int` take underscores, infinities and digits of other scripts."""
    tree = ast.parse(Path(cli.__file__).read_text())
    readers = [n.value for n in ast.walk(tree) if isinstance(n, ast.keyword) and n.arg == "type"]
    called = [n.func for n in ast.walk(tree) if isinstance(n, ast.Call)]
    names = {n.id for n in [*readers, *called] if isinstance(n, ast.Name)}
    assert "whole_number" in names
    assert not {"int", "float", "complex", "eval"} & names
