"""The rules hold for every step, and are found broken in a log whose chain is right."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from hdsafebo.errors import HdSafeBOError, ParamsError
from hdsafebo.files.yaml import read_mapping, write_mapping
from hdsafebo.session.create import create_session
from hdsafebo.session.errors import AuditError, DefinitionError, LimitError, ProtocolError
from hdsafebo.session.log.chain import Entry, seal, write_rows
from hdsafebo.session.log.layout import write_session
from hdsafebo.session.log.payloads import KINDS
from hdsafebo.session.session import Session
from hdsafebo.session.views.audit import replay, verify_export, verify_session
from hdsafebo.session.views.export import export_session, safe_cell
from hdsafebo.session.views.report import write_report
from hdsafebo.session.views.summary import status
from tests.session.small import approve_open, bowl, measured, refuse_open

Make = Callable[..., Session]
Payload = dict[str, Any]
HOME = {"values": [0.5, 0.5, 0.0]}
REACH = ([0.5, 0.5, 0.0], [0.3, 0.3, 0.6])
FAR = {"values": [0.95, 0.5, 0.0]}
BELIEF = {
    "objective": {"mean": 0.5, "sd": 0.1},
    "safety": {"margin": {"mean": 0.1, "low": 0.0, "high": 0.2}},
    "safe_probability": 0.99,
    "violation_bound": None,
    "trust_region_length": 0.5,
    "marked_unsafe": False,
}


def recorded(number: int, **changes: Any) -> Payload:
    values = bowl([0.5, 0.5, 0.0])
    outcomes = {name: values[name] for name in ("speed", "economy")}
    return {
        "trial": number,
        "outcomes": outcomes,
        "safety": {"margin": values["margin"]},
        "details": {},
        "failure": None,
        "delivered": True,
    } | changes


# --- a pause between the start and the record of a trial


@pytest.mark.parametrize("pauses", [0, 1, 2])
@pytest.mark.parametrize("recorded_while_stopped", [False, True])
def test_steps_start_anew_after_a_pause_wherever_it_lies(
    make_session: Make, pauses: int, recorded_while_stopped: bool
) -> None:
    """What was delivered before a pause allows no step from there after it."""
    session = make_session()
    trial = session.manual("ann", {"values": [0.8, 0.5, 0.0]})
    for number in range(pauses):
        session.stop("ann", "pause")
        if recorded_while_stopped and number == pauses - 1:
            session.record("ann", measured(trial))
        session.resume("ann")
    if session.state.running is not None:
        session.record("ann", measured(trial))
    assert session.state.last_point == (None if pauses else {"values": [0.8, 0.5, 0.0]})
    if pauses:
        with pytest.raises(LimitError, match=r"a is 0.95, permitted now 0.2 to 0.8"):
            session.manual("ann", FAR)
        for _ in range(3):
            point = session.suggest("ann").point
            assert all(abs(v - h) <= s for v, h, s in zip(point["values"], *REACH, strict=True))
            refuse_open(session, "only looking")
    else:
        session.manual("ann", FAR)
    verify_session(Session.open(session.store.directory))


# --- limits far smaller than the range of an input


WIDE = [
    {"name": "a", "lower": -1e9, "upper": 1e9, "max_step": 0.5, "home": 0.0},
    {"name": "b", "lower": 0.0, "upper": 1e9},
    {"name": "c", "lower": -1.0, "upper": 1.0},
]


def test_rounding_permits_no_more_than_rounding_however_wide_the_range(make_session: Make) -> None:
    """An input without a limit worth the name, with a small step or tightened later."""
    session = make_session(inputs=WIDE)
    for beyond in ([0.51, 0.0, 0.0], [0.5 + 1e-5, 0.0, 0.0]):
        with pytest.raises(LimitError, match="permitted now"):
            session.manual("ann", {"values": beyond})
    source = Path(session.state.source)
    tighter = read_mapping(source, ParamsError)
    tighter["inputs"][1]["upper"] = 1.0
    write_mapping(source, tighter, ParamsError)
    session.tighten("ann", source)
    for beyond in ([0.0, 1.9, 0.0], [0.0, 1.0 + 1e-5, 0.0]):
        with pytest.raises(LimitError, match="permitted now"):
            session.manual("ann", {"values": beyond})
    session.manual("ann", {"values": [0.5, 1.0, 0.0]})


@pytest.mark.parametrize("step", ["suggest", "approve", "manual", "tighten"])
def test_a_session_file_that_brings_a_step_is_refused_in_words(make_session: Make, step: str) -> None:
    """Steps that were not there when the session was made are no tighter limit of what it has."""
    plain = [{"name": n, "lower": -1.0, "upper": 1.0} for n in "abc"]
    session = make_session(inputs=plain)
    source = Path(session.state.source)
    changed = read_mapping(source, ParamsError)
    changed["inputs"][0] |= {"max_step": 0.1, "home": 0.5, "upper": 0.9}
    write_mapping(source, changed, ParamsError)
    with pytest.raises(DefinitionError, match=r"inputs\.0\.(max_step|upper)"):
        {
            "suggest": lambda: session.suggest("ann"),
            "approve": lambda: session.approve("ann", 1),
            "manual": lambda: session.manual("ann", HOME),
            "tighten": lambda: session.tighten("ann", source),
        }[step]()


# --- lists


def test_in_a_list_only_its_rows_are_delivered(make_session: Make) -> None:
    session = make_session("list")
    suggestion = session.suggest("ann")
    for point in ({"values": [0.543, 0.487, 0.05]}, {"values": [0.5, 0.5, 1e-12]}):
        for step in (
            lambda p=point: session.modify("ann", p, "off the list", suggestion.number),
            lambda p=point: session.manual("ann", p),
        ):
            with pytest.raises(LimitError, match="none of the 1331 rows of the list"):
                step()
    assert session.entries[-1].kind == "suggested"
    session.modify("ann", session.space.parse("a=0.6", HOME), "on the list", suggestion.number)


def test_what_was_not_delivered_is_suggested_again(make_session: Make) -> None:
    for kind in ("box", "list"):
        session = make_session(kind, name=kind)
        first = session.suggest("ann")
        approve_open(session)
        session.not_delivered("ann", "the lead came off")
        assert session.suggest("ann").point == first.point
        again = Session.open(session.store.directory)
        session.record("ann", measured(approve_open(session)))
        again.refresh()
        assert session.suggest("ann").point != first.point
        assert replay(session) == []


def test_a_list_that_is_used_up_is_said_to_be(make_session: Make, tmp_path: Path) -> None:
    session = make_session("list", name="first")
    files = tmp_path / "first-files"
    rows = (files / "initial.csv").read_text().split("\n")[1:-1]
    table = ["a,b,c", *(",".join(row.split(",")[:3]) for row in rows)]
    (files / "candidates.csv").write_text("\n".join(table) + "\n")
    session = create_session(
        tmp_path / "used", files / "session.yaml", who="ann", initial=files / "initial.csv"
    )
    with pytest.raises(ProtocolError, match="each of the 8 candidates was tried, declined, or is outside"):
        session.suggest("ann")


# --- logs of steps that were not permitted


def broken_steps(session: Session) -> dict[str, list[tuple[Payload, str]]]:
    """For each kind of entry payloads that break a rule while suggestion 1 is open, and what is said."""
    head = len(session.entries)
    suggested = {"based_on": head, "target": "speed", "point": HOME, "belief": BELIEF}
    definition = session.state.definition
    return {
        "created": [(session.entries[0].payload, "is made already")],
        "suggested": [(suggested, "suggestion 1 waits")],
        "abstained": [({"based_on": head - 1, "target": "speed", "reason": "x"}, "the log is at entry")],
        "approved": [({"suggestion": 2}, "there is no suggestion 2")],
        "modified": [
            ({"suggestion": 1, "point": FAR, "reason": "x"}, "outside the hard limits"),
            ({"suggestion": 7, "point": HOME, "reason": "x"}, "there is no suggestion 7"),
        ],
        "refused": [({"suggestion": 2, "reason": "x"}, "there is no suggestion 2")],
        "manual": [({"point": FAR, "reason": ""}, "outside the hard limits")],
        "recorded": [
            (recorded(9), "there is no trial 9|makes no sense"),
            (recorded(1), "there is no trial 1"),
        ],
        "target_switched": [({"target": "speed"}, "the target already")],
        "resumed": [({}, "not stopped")],
        "tightened": [({"definition": definition, "reason": ""}, "no hard limit is tighter")],
    }


WITHOUT_RULES = {"stopped", "noted", "converted", "repaired"}  # may stand anywhere, and start nothing


def test_every_kind_of_entry_has_a_rule_or_needs_none(make_session: Make) -> None:
    session = make_session()
    assert set(broken_steps(session)) | WITHOUT_RULES == set(KINDS)


@pytest.mark.parametrize("kind", sorted(set(KINDS) - WITHOUT_RULES))
def test_a_rightly_chained_log_that_breaks_the_rules_is_not_intact(
    make_session: Make, kind: str, tmp_path: Path
) -> None:
    session = make_session()
    session.suggest("ann")
    log = tmp_path / "audit.log"
    for payload, message in broken_steps(session)[kind]:
        head = session.entries[-1]
        forged = seal(head.seq + 1, head.time, "eve", kind, payload, head.hash)
        write_session(tmp_path / "s", [*session.entries, forged], [])
        log.write_bytes(write_rows([*session.entries, forged]))
        for check in (
            lambda: verify_session(Session.open(tmp_path / "s", read_only=True)),
            lambda: verify_export(log),
            lambda: write_report(Session.open(tmp_path / "s"), tmp_path / "report.html"),
        ):
            with pytest.raises(AuditError, match=message):
                check()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"outcomes": {"speed": 1.0}}, "economy missing"),
        ({"safety": {"x": 1.0}}, "margin missing"),
        ({"safety": None}, "without safety values"),
        ({"outcomes": None}, "without safety values, or a failure"),
        ({"failure": "x"}, "a failure with outcomes"),
        ({"delivered": False}, "not delivered"),
        ({"trial": 10}, "there is no trial 10"),
    ],
)
def test_results_that_do_not_fit_are_not_intact(
    make_session: Make, changes: Payload, message: str, tmp_path: Path
) -> None:
    session = make_session()
    session.manual("ann", HOME)
    head = session.entries[-1]
    good = seal(head.seq + 1, head.time, "eve", "recorded", recorded(9), head.hash)
    bad = seal(head.seq + 1, head.time, "eve", "recorded", recorded(9, **changes), head.hash)
    path = tmp_path / "audit.log"
    path.write_bytes(write_rows([*session.entries, good]))
    verify_export(path)
    path.write_bytes(write_rows([*session.entries, bad]))
    with pytest.raises(AuditError, match=message):
        verify_export(path)


def test_a_forged_start_with_a_wrong_limit_is_found(make_session: Make, tmp_path: Path) -> None:
    """An approved suggestion at 99 where the limit is 1; a step that was too large at its time only."""
    session = make_session()
    entries = list(session.entries)
    for values in ([99.0, 0.5, 0.0], [0.81, 0.5, 0.0]):
        forged = chain_on(
            entries,
            [
                (
                    "suggested",
                    {"based_on": 1, "target": "speed", "point": {"values": values}, "belief": BELIEF},
                ),
                ("approved", {"suggestion": 1}),
                ("recorded", recorded(9)),
            ],
        )
        (tmp_path / "audit.log").write_bytes(write_rows(forged))
        with pytest.raises(AuditError, match=r"log entry 2 \(suggested\) was not permitted: .*hard limits"):
            verify_export(tmp_path / "audit.log")


def chain_on(entries: list[Entry], steps: list[tuple[str, Payload]]) -> list[Entry]:
    """A log with further entries, rightly chained."""
    log = list(entries)
    for kind, payload in steps:
        last = log[-1] if log else None
        number, previous = (last.seq + 1, last.hash) if last else (1, "0" * 64)
        log.append(seal(number, "2026-03-02T09:00:00+00:00", "eve", kind, payload, previous))
    return log


# --- texts that somebody else has written

HOSTILE = ["</code><script>alert(1)</script>", "=HYPERLINK(1)", "a\u202eb\nc\x9b", '" onload="x', "x" * 300]


def leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Places of all texts in plain data."""
    if isinstance(value, str):
        yield path
    elif isinstance(value, dict):
        for key, part in value.items():
            yield from leaves(part, (*path, key))
    elif isinstance(value, list):
        for number, part in enumerate(value[:2]):
            yield from leaves(part, (*path, number))


def test_no_text_of_a_log_gets_into_a_page_or_a_table_as_it_is(make_session: Make, tmp_path: Path) -> None:
    """Every text of every entry, one at a time, in a log whose chain is right."""
    session = make_session()
    session.suggest("ann")
    refuse_open(session, "no")
    session.record("ann", measured(session.manual("ann", HOME, "mine")), remark="fine")
    session.note("ann", "coffee")
    session.stop("ann", "lunch")
    session.resume("ann")
    session.switch_target("ann", "economy")
    plain = [{"who": e.who, "time": e.time, "kind": e.kind, "payload": e.payload} for e in session.entries]
    initial = (tmp_path / "s-files" / "initial.csv").read_bytes()
    taken = 0
    for place in leaves(plain):
        for text in HOSTILE:
            data = json.loads(json.dumps(plain))
            parent = data
            for key in place[:-1]:
                parent = parent[key]
            parent[place[-1]] = text
            log: list[Entry] = []
            try:
                for d in data:
                    last = log[-1] if log else None
                    number, previous = (last.seq + 1, last.hash) if last else (1, "0" * 64)
                    log.append(seal(number, d["time"], d["who"], d["kind"], d["payload"], previous))
                write_session(tmp_path / "h", log, [initial])
                hostile = Session.open(tmp_path / "h", read_only=True)
                page = write_report(hostile, tmp_path / "report.html").read_text()
                tables = export_session(hostile, tmp_path / "out")
            except HdSafeBOError:
                continue  # a typed field, or one that says what cannot be
            taken += 1
            assert not any(mark in page for mark in ("<script", '" onload', "\u202e", "\x9b"))
            for table in tables[1:3]:
                cells = table.read_text().replace("\n", ",").split(",")
                assert not [c for c in cells if c.startswith(("=", "@", "\t"))]
                assert "\u202e" not in table.read_text()
            json.dumps(status(hostile), allow_nan=False)
    assert taken > 20


@pytest.mark.parametrize("text", ["=1", "+1", "-1", "@x", "\t=1", " =1", "|x", "%x", "\uff1dx", "\n=1"])
def test_no_cell_begins_a_formula(text: str) -> None:
    assert str(safe_cell(text)).startswith(("'", "\\"))
    assert safe_cell(-1.5) == -1.5
    assert safe_cell("plain") == "plain"
