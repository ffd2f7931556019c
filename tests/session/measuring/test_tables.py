"""Tables: comments are no part of them, numbers are plain decimal digits, and messages name the line."""

from __future__ import annotations

import io

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from hdsafebo.session.advice.setup import make_space
from hdsafebo.session.candidates.list_set import candidate_values
from hdsafebo.session.definition import parse_definition
from hdsafebo.session.errors import RecordingError
from hdsafebo.session.measuring import tables
from hdsafebo.session.measuring.tables import MeasuredTable, read_table
from hdsafebo.session.spaces.generic import GenericSpace
from tests.session.small import box_definition

PLAIN = "a,b,c\n0.1,0.2,-0.3\n0.4,0.5,0\n"


def content(table: MeasuredTable) -> list[list[str]]:
    return [[table.text(row, column) for column in table.columns] for row in range(len(table))]


@pytest.mark.parametrize(
    "text",
    [
        "# of Monday\n# seen by ann\n" + PLAIN,
        "\ufeff" + PLAIN,
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\n\n"),
        PLAIN.replace("a,b", '"a", b '),
    ],
)
def test_comments_and_line_ends_make_no_other_table(text: str) -> None:
    expected = read_table(PLAIN.encode(), "t.csv")
    found = read_table(text.encode(), "t.csv")
    assert found.columns == expected.columns
    assert content(found) == content(expected)
    np.testing.assert_array_equal(found.numbers("abc"), [[0.1, 0.2, -0.3], [0.4, 0.5, 0.0]])


def test_messages_name_the_line_of_the_file() -> None:
    table = read_table((b"# one\n# two\na,b,c\n\n1,2,3\n\n4,x,6\n"), "t.csv")
    assert [table.at(row) for row in range(2)] == ["t.csv, line 5", "t.csv, line 7"]
    with pytest.raises(RecordingError, match=r"t\.csv, line 7, column b: 'x' is no finite number"):
        table.numbers("ab")
    with pytest.raises(RecordingError, match=r"t\.csv, line 3: 2 values, expected 3"):
        read_table(b"# one\na,b,c\n1,2\n", "t.csv")


@pytest.mark.parametrize("cell", ["1_0", "nan", "inf", "1e999", "0x10", "٣", "1 2", "1,5", "--1", "e5", "="])
def test_what_is_no_plain_number_is_refused(cell: str) -> None:
    table = read_table(f'a,b\n"{cell}",1\n'.encode(), "t.csv")
    with pytest.raises(RecordingError, match=r"t\.csv, line 2, column a: .* is no finite number"):
        table.number(0, "a")


def test_parquet_gives_what_csv_gives() -> None:
    buffer = io.BytesIO()
    columns = {"a": [0.1, None], "b": [1, 2], "c": ["0.3", " "], "d": [True, False], "e": [float("nan"), 1.0]}
    pq.write_table(pa.table(columns), buffer)
    table = read_table(buffer.getvalue(), "t.parquet")
    assert [[table.number(row, c) for c in "abc"] for row in range(2)] == [[0.1, 1.0, 0.3], [None, 2.0, None]]
    for column in "de":
        with pytest.raises(
            RecordingError, match=rf"t\.parquet, line 1, column {column}: .* is no finite number"
        ):
            table.number(0, column)


def test_large_tables_are_read_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "a,b\n" + "".join(f"{i},{'x' * (i % 7)}\n" for i in range(200))
    whole = content(read_table(text.encode(), "t.csv"))
    for name in ("_CHUNK", "_CHUNK_LETTERS"):
        monkeypatch.setattr(tables, name, 20)
        assert content(read_table(text.encode(), "t.csv")) == whole


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a\n" + "1\n" * (tables.MAX_ROWS + 1), "more than 262144 rows"),
        ("a\n" + "\n" * (4 * tables.MAX_ROWS), "more than 1048576 lines"),
        ("a\n" + "1" * (2**20 + 1), "line 2: more than 1048576 characters"),
        (",".join(map(str, range(10_001))), "10001 columns, expected at most 10000"),
        ("# nothing else", "is empty, expected a header line"),
        ("", "is empty, expected a header line"),
    ],
)
def test_tables_of_any_size_are_refused_with_the_limit(text: str, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        read_table(text.encode(), "t.csv")


def test_equal_candidates_are_named_by_their_lines() -> None:
    space = make_space(parse_definition(box_definition("list")))
    assert isinstance(space, GenericSpace)
    for first, second in (("0.5,0.5,0", "0.50,5e-1,-0.0"), ("0.1,0.2,0.3", "0.1,0.2,0.3")):
        table = read_table(f"# rows\na,b,c\n{first}\n0.3,0.3,0.3\n{second}\n".encode(), "t.csv")
        with pytest.raises(RecordingError, match=r"t\.csv, line 5: the same as line 3"):
            candidate_values(table, space)
    with pytest.raises(RecordingError, match=r"t\.csv, line 3: a, c outside the limits"):
        candidate_values(read_table(b"a,b,c\n0,0,0\n2,0.5,-9\n", "t.csv"), space)
