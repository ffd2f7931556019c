"""Sessions of robots: limits on either side, inputs without steps, several trials at the same time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import write_mapping
from hdsafebo.optimizers.local.constrained.search import ConstrainedSearch
from hdsafebo.session.create import create_session
from hdsafebo.session.definition import parse_definition
from hdsafebo.session.errors import DefinitionError, ExpiredError, LimitError, ProtocolError
from hdsafebo.session.log.state import LoggedTrial
from hdsafebo.session.session import Session
from hdsafebo.session.spaces.generic import GenericSpace
from hdsafebo.session.spaces.space import Report
from hdsafebo.session.views.audit import replay, verify_session
from hdsafebo.session.views.report import write_report
from hdsafebo.session.views.summary import status
from tests.session.small import approve_open, bowl, box_definition, write_box_files


def without_steps(kind: str = "box", **changes: Any) -> dict[str, Any]:
    """A session file whose inputs move freely, with an upper limit."""
    data = box_definition(kind)
    for entry in data["inputs"]:
        del entry["max_step"], entry["home"]
    data["safety"] = [{"name": "strain", "at_most": 0.0}]
    return data | {"at_once": 3} | changes


def run(trial: LoggedTrial) -> Report:
    """The bowl; strain is its margin with the sign turned."""
    values = bowl(trial.point["values"])
    return Report(
        values={"speed": values["speed"], "economy": values["economy"], "strain": -values["margin"]}
    )


@pytest.fixture
def make(tmp_path: Path) -> Callable[..., Session]:
    """Makes a session of three robots."""

    def made(kind: str = "box", name: str = "s", **changes: Any) -> Session:
        definition, initial = write_box_files(tmp_path / name, kind, 20)
        write_mapping(definition, without_steps(kind, **changes), ParamsError)
        lines = initial.read_text().splitlines()
        rows = [line.split(",") for line in lines[1:]]
        turned = [",".join([*row[:-1], repr(-float(row[-1]))]) for row in rows]
        initial.write_text("\n".join(["a,b,c,speed,economy,strain", *turned]) + "\n")
        return create_session(tmp_path / f"{name}-session", definition, who="ann", initial=initial)

    return made


@pytest.mark.parametrize("kind", ["box", "list"])
def test_three_robots_run_at_once_and_finish_in_any_order(make: Callable[..., Session], kind: str) -> None:
    session = make(kind)
    for order in ((2, 0, 1), (0, 2, 1), (1, 2, 0)):
        trials = []
        for _ in range(3):
            session.suggest("ann")
            trials.append(approve_open(session))
        assert len({repr(t.point) for t in trials}) == 3
        with pytest.raises(ProtocolError, match=r"cannot suggest: trials \d+, \d+, \d+ wait"):
            session.suggest("ann")
        with pytest.raises(ProtocolError, match="say which one"):
            session.record("ann", run(trials[0]))
        with pytest.raises(ProtocolError, match="cannot switch the target"):
            session.switch_target("ann", "economy")
        for i in order:
            session.record("ann", run(trials[i]), trials[i].number)
    later = [t for t in session.state.trials if t.origin == "suggested"]
    assert len(later) == 9
    assert all(t.outcomes == {k: run(t).values[k] for k in ("speed", "economy")} for t in later)
    told = session.advisor()._require().trials
    assert told.completed.sum() == len(session.state.trials), "every result is known to the optimiser"
    verify_session(session)
    assert replay(session) == []
    assert replay(Session.open(session.store.directory)) == []


def test_a_result_expires_what_was_suggested_without_it(make: Callable[..., Session]) -> None:
    session = make()
    session.suggest("ann")
    first = approve_open(session)
    open_one = session.suggest("ann")
    session.record("ann", run(first), first.number)
    with pytest.raises(ExpiredError, match="ask for a new one"):
        session.approve("ann", open_one.number)
    told = session.advisor()._require().trials
    assert told.completed.sum() == len(session.state.trials)
    session.suggest("ann")
    assert replay(session) == []


@pytest.mark.parametrize("kind", ["box", "list"])
def test_one_of_several_is_not_delivered(make: Callable[..., Session], kind: str) -> None:
    session = make(kind)
    trials = []
    for _ in range(2):
        session.suggest("ann")
        trials.append(approve_open(session))
    session.not_delivered("ann", "the gripper jammed", trials[0].number)
    session.record("ann", run(trials[1]), trials[1].number)
    session.suggest("ann")
    session.record("ann", run(approve_open(session)))
    assert len(session.advisor()._require().trials.z) >= len(session.state.trials)
    assert replay(session) == []
    assert replay(Session.open(session.store.directory)) == []


def test_a_running_trial_of_ones_own_is_not_suggested_beside_it(make: Callable[..., Session]) -> None:
    session = make("list", at_once=2)
    suggestion = session.suggest("ann")
    own = session.manual("ann", suggestion.point)
    assert session.suggest("ann").point != own.point


def test_upper_limits_are_kept_in_their_own_sign(make: Callable[..., Session], tmp_path: Path) -> None:
    session = make()
    assert session.space.safe({"strain": -0.1})
    assert not session.space.safe({"strain": 0.1})
    assert session.space.limits() == {"strain": "at most 0"}
    suggestion = session.suggest("ann")
    believed = suggestion.belief["safety"]["strain"]
    assert believed["low"] <= believed["mean"] <= believed["high"]
    assert believed["mean"] == pytest.approx(run_of(suggestion.point), abs=0.1)
    trial = approve_open(session)
    session.record("ann", Report(values={"speed": 1.0, "economy": 1.0, "strain": 0.5}))
    assert status(session)["counts"]["unsafe_recommended"] == 1
    page = write_report(session, tmp_path / "report.html").read_text()
    for word in ("medical", "stimul", "patient", "therapist", "current", "contact"):
        assert word not in page.lower(), word
    assert trial.number == len(session.state.trials)


def test_an_upper_limit_is_a_lower_one_of_the_turned_quantity(
    make: Callable[..., Session], tmp_path: Path
) -> None:
    one = make()
    definition, initial = write_box_files(tmp_path / "other", "box", 20)
    data = without_steps(safety=[{"name": "margin", "at_least": 0.0}])
    write_mapping(definition, data, ParamsError)
    other = create_session(tmp_path / "other-session", definition, who="ann", initial=initial)
    for _ in range(3):
        assert one.suggest("ann").point == other.suggest("ann").point
        trial = approve_open(one)
        one.record("ann", run(trial))
        other.record("ann", Report(values=bowl(approve_open(other).point["values"])))
    assert [t.belief["safe_probability"] for t in one.state.trials if t.belief] == [
        t.belief["safe_probability"] for t in other.state.trials if t.belief
    ]


def run_of(point: dict[str, Any]) -> float:
    """The true strain."""
    return -bowl(point["values"])["margin"]


def test_without_steps_the_whole_box_is_searched(make: Callable[..., Session], tmp_path: Path) -> None:
    session = make()
    session.manual("ann", {"values": [0.9, 0.9, -0.9]})  # far from everything
    session.not_delivered("ann", "only a test")
    with pytest.raises(LimitError, match=r"a is 1.5, permitted now 0 to 1"):
        session.manual("ann", {"values": [1.5, 0.5, 0.0]})
    search = session.advisor()._require().search  # type: ignore[attr-defined]
    assert isinstance(search, ConstrainedSearch)
    tighter = without_steps()
    tighter["inputs"][0]["upper"] = 0.6
    write_mapping(tmp_path / "tight.yaml", tighter, ParamsError)
    session.tighten("ann", tmp_path / "tight.yaml", "the arm hits the table")
    for _ in range(4):
        assert session.suggest("ann").point["values"][0] <= 0.6
        session.record("ann", run(approve_open(session)))
    assert replay(Session.open(session.store.directory)) == []


def test_a_session_without_data_says_how_to_begin(tmp_path: Path) -> None:
    definition, _ = write_box_files(tmp_path / "files")
    write_mapping(definition, without_steps(), ParamsError)
    session = create_session(tmp_path / "s", definition, who="ann")
    with pytest.raises(ProtocolError, match="begin with a trial of your own"):
        session.suggest("ann")
    session.record("ann", run(session.manual("ann", {"values": [0.5, 0.5, 0.0]})))
    assert session.suggest("ann").number == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"safety": [{"name": "strain"}]}, "strain: limits given: none; expected at_least or at_most"),
        ({"safety": [{"name": "strain", "at_most": 1.0, "at_least": 0.0}]}, "given: at_least, at_most"),
        (
            {"inputs": [{"name": "a", "lower": 0.0, "upper": 1.0, "home": 0.5}]},
            "max_step is None and home is 0.5",
        ),
        ({"inputs": [{"name": "a", "lower": 2.0, "upper": 1.0}]}, "expected lower <= upper, got 2.0, 1.0"),
        ({"at_once": 0}, "at_once"),
        ({"inputs": box_definition()["inputs"]}, "at_once is 3, and a, b, c may only move in steps"),
    ],
)
def test_malformed_files_are_refused_by_name(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    definition, initial = write_box_files(tmp_path / "files")
    write_mapping(definition, without_steps(**change), ParamsError)
    with pytest.raises(DefinitionError, match=message):
        create_session(tmp_path / "s", definition, who="ann", initial=initial)


@pytest.mark.parametrize(
    ("lower", "upper", "max_step"),
    [
        (0.0, 1.0, None),
        (1e6, 1e6 + 1.0, None),
        (-273.15, -273.05, None),
        (0.0, 1e6, 1e-3),
        (1e-9, 3e-9, None),
        (1.0, 1.0 + 2**-52, None),
        (0.0, 1.0, 5e-324),
        (5.0, 5.0, None),
    ],
)
def test_who_sets_what_is_shown_delivers_what_was_judged(
    lower: float, upper: float, max_step: float | None
) -> None:
    """Six digits of a value between 1,000,000 and 1,000,001 are those of another trial."""
    steps = {} if max_step is None else {"max_step": max_step, "home": upper}
    entry: dict[str, Any] = {"name": "x", "lower": lower, "upper": upper, **steps}
    space = GenericSpace(parse_definition(box_definition() | {"inputs": [entry]}))  # type: ignore[arg-type]
    span = upper - lower if max_step is None else max_step
    for share in (0.0, 0.123456789012, 2 / 3, 1.0):
        value = lower + share * span
        (shown,) = space.parse(space.describe({"values": [value]}), None)["values"]
        assert abs(shown - value) <= 5e-5 * span
        assert lower <= shown <= upper


def test_what_is_shown_of_a_trial_at_its_limit_keeps_the_limit() -> None:
    inputs = [{"name": "x", "lower": 0.1234567, "upper": 1.2345678}]
    space = GenericSpace(parse_definition(box_definition() | {"inputs": inputs}))  # type: ignore[arg-type]
    assert space.describe({"values": [1.2345678]}) == "x=1.2345678"
    assert space.describe({"values": [0.1234567]}) == "x=0.123457"
    assert space.describe({"values": [1.2345671]}) == "x=1.2345671"
    assert space.describe({"values": [0.7]}) == "x=0.7"


def test_what_a_value_is_refused_for_can_be_seen() -> None:
    inputs = [{"name": "x", "lower": 1e6, "upper": 1e6 + 0.5}]
    space = GenericSpace(parse_definition(box_definition() | {"inputs": inputs}))  # type: ignore[arg-type]
    (said,) = space.breaches({"values": [1e6 + 0.7]}, None)
    assert said == "x is 1000000.7, permitted now 1000000 to 1000000.5"
