"""Tables and values of a session, spoilt at random: taken and finite, or refused by name; the log stays."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hdsafebo.session.advice.setup import make_space
from hdsafebo.session.definition import parse_definition
from hdsafebo.session.errors import RecordingError, SessionError
from hdsafebo.session.measuring.tables import read_table
from hdsafebo.session.session import Session
from hdsafebo.session.spaces.space import Report
from tests.session.small import bowl, box_definition

COLUMNS = ["a", "b", "c", "speed", "economy", "margin"]
ROWS = [[p, 0.5, 0.0, *bowl([p, 0.5, 0.0]).values()] for p in (0.4, 0.45, 0.5, 0.55)]
CELLS = st.one_of(
    st.floats(),
    st.floats(0, 1),
    st.integers(-(2**62), 2**62),
    st.none(),
    st.text(max_size=8),
    st.sampled_from(
        ["", " ", "nan", "inf", "1e999", "0x10", "1_0", "=1+1", "1;2", "٣", '"', "a\nb", "\x00", "1.5 "]
    ),
)
CHANGES = st.one_of(
    st.tuples(st.just("cell"), st.integers(0, 3), st.integers(0, 5), CELLS),
    st.tuples(
        st.just("header"), st.integers(0, 5), st.text(max_size=5) | st.sampled_from([*COLUMNS, "time", ""])
    ),
    st.tuples(st.just("drop"), st.integers(0, 5)),
    st.tuples(st.just("repeat"), st.integers(0, 3)),
    st.tuples(st.just("empty")),
)


def changed(changes: list[tuple[Any, ...]]) -> tuple[list[str], list[list[Any]]]:
    """Header and rows of the initial trials with changes."""
    header, rows = list(COLUMNS), [list(row) for row in ROWS]
    for kind, *what in changes:
        if kind == "cell" and what[0] < len(rows) and what[1] < len(header):
            rows[what[0]][what[1]] = what[2]
        elif kind == "header" and what[0] < len(header):
            header[what[0]] = what[1]
        elif kind == "drop" and what[0] < len(header):
            header.pop(what[0])
            for row in rows:
                row.pop(what[0])
        elif kind == "repeat" and what[0] < len(rows):
            rows.append(list(rows[what[0]]))
        elif kind == "empty":
            rows.clear()
    return header, rows


def as_csv(header: list[str], rows: list[list[Any]]) -> bytes:
    lines = [",".join("" if cell is None else str(cell) for cell in row) for row in [header, *rows]]
    return "\n".join(lines).encode()


def as_parquet(header: list[str], rows: list[list[Any]]) -> bytes | None:
    """None where no parquet file can hold such columns."""
    buffer = io.BytesIO()
    try:
        arrays = [pa.array([row[i] for row in rows]) for i in range(len(header))]
        pq.write_table(pa.Table.from_arrays(arrays, names=header), buffer)
    except (pa.ArrowException, OverflowError, TypeError):
        return None
    return buffer.getvalue()


@settings(
    max_examples=300, derandomize=True, database=None, deadline=None,
    suppress_health_check=list(HealthCheck),
)  # fmt: skip
@given(st.lists(CHANGES, min_size=1, max_size=3), st.sampled_from(["csv", "parquet"]), st.integers(0, 400))
def test_three_hundred_tables_of_initial_trials(
    changes: list[tuple[Any, ...]], suffix: str, cut: int
) -> None:
    header, rows = changed(changes)
    content = as_csv(header, rows) if suffix == "csv" else as_parquet(header, rows)
    if content is None:
        return
    if cut < 40:
        content = content[: -cut or None]
    space = make_space(parse_definition(box_definition()))
    trials, refusal = [], f"initial.{suffix}"
    try:
        trials = space.initial_trials(read_table(content, f"initial.{suffix}"))
    except RecordingError as error:
        refusal = str(error)
    assert refusal.startswith(f"initial.{suffix}")
    for trial in trials:
        numbers = [*trial["point"]["values"], *trial["safety"].values(), *(trial["outcomes"] or {}).values()]
        assert all(math.isfinite(number) for number in numbers)
        assert all(-1 <= value <= 1 for value in trial["point"]["values"])


VALUES = st.dictionaries(
    st.sampled_from(["speed", "economy", "margin", "a", ""]),
    st.floats() | st.floats(-1, 1) | st.sampled_from([None, "1", True, 10**400, [1.0], 1e308]),
    max_size=4,
)


@pytest.fixture
def session(make_session: Callable[..., Session]) -> Session:
    return make_session()


def test_two_hundred_records_of_one_session(session: Session) -> None:
    """What is refused leaves no trace; what is taken is finite and comes back after reopening."""
    taken: list[int] = []

    @settings(
        max_examples=200, derandomize=True, database=None, deadline=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(VALUES)
    def try_one(values: dict[str, Any]) -> None:
        if session.state.running is None:
            session.manual("ann", {"values": [0.5, 0.5, 0.0]})
        head = session.entries[-1]
        try:
            trial = session.record("ann", Report(values=values))
        except SessionError:
            assert session.entries[-1] == head
            assert session.state.running is not None
        else:
            measured = [*(trial.safety or {}).values(), *(trial.outcomes or {}).values()]
            assert all(math.isfinite(value) for value in measured)
            taken.append(trial.number)

    try_one()
    assert taken
    reopened = Session.open(session.store.directory)
    assert [e.hash for e in reopened.entries] == [e.hash for e in session.entries]
    assert set(taken) <= {t.number for t in reopened.state.trials}
