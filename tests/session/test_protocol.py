"""The protocol: what may follow what, what expires, what is refused, and what the optimiser learns."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import write_mapping
from hdsafebo.session.advice.advisor_cache import restored_advisor
from hdsafebo.session.create import create_session
from hdsafebo.session.errors import (
    DefinitionError,
    ExpiredError,
    LimitError,
    ProtocolError,
    RecordingError,
    SessionError,
)
from hdsafebo.session.log.chain import START, seal
from hdsafebo.session.log.store import MovedOnError
from hdsafebo.session.session import Session
from hdsafebo.session.spaces.space import Report
from hdsafebo.session.views.export import export_session
from tests.session.small import approve_open, bowl, box_definition, measured, refuse_open, write_box_files

Make = Callable[..., Session]


def near_home() -> dict[str, list[float]]:
    return {"values": [0.5, 0.5, 0.0]}


@pytest.mark.parametrize("kind", ["box", "list"])
def test_suggest_approve_record_learns(make_session: Make, kind: str) -> None:
    session = make_session(kind)
    start = session.best()
    assert start is not None
    for _ in range(6):
        suggestion = session.suggest("ann")
        assert suggestion.belief["safe_probability"] > 0.9
        trial = session.approve("ann", suggestion.number)
        assert trial.point == suggestion.point
        done = session.record("ann", measured(trial))
        assert done.outcomes is not None
    best = session.best()
    assert best is not None
    assert best.outcomes is not None
    assert start.outcomes is not None
    assert best.outcomes["speed"] > start.outcomes["speed"]


def test_a_suggestion_is_in_the_log_before_it_is_shown(make_session: Make) -> None:
    session = make_session()
    suggestion = session.suggest("ann")
    reader = Session.open(session.store.directory)
    assert reader.entries[-1].kind == "suggested"
    assert reader.entries[-1].payload["point"] == suggestion.point
    assert reader.suggest("bob") == suggestion  # the open one again, nothing new is computed
    assert len(reader.entries) == 2


def test_steps_are_limited_from_the_last_delivered(make_session: Make) -> None:
    session = make_session()
    with pytest.raises(LimitError, match=r"a is 0\.81, permitted now 0\.2 to 0\.8"):
        session.manual("ann", {"values": [0.81, 0.5, 0.0]})
    trial = session.manual("ann", {"values": [0.8, 0.5, 0.0]})
    session.record("ann", measured(trial))
    with pytest.raises(LimitError, match=r"a is 0\.49, permitted now 0\.5 to 1"):
        session.manual("ann", {"values": [0.49, 0.5, 0.0]})
    session.stop("ann", "pause")
    session.resume("ann")
    session.manual("ann", {"values": [0.49, 0.5, 0.0]})  # from home again


def test_a_suggestion_is_approved_within_the_limits_of_the_moment(make_session: Make) -> None:
    """They were checked when it was made; whatever has happened since, they are again."""
    session = make_session()
    number = session.suggest("ann").number
    inputs = [i.model_copy(update={"upper": i.lower, "home": i.lower}) for i in session.definition.inputs]  # type: ignore[union-attr]
    session.space.tighten(session.definition.model_copy(update={"inputs": inputs}))
    with pytest.raises(LimitError, match="permitted now"):
        session.approve("ann", number)
    assert session.entries[-1].kind == "suggested"


def test_a_trial_that_was_not_delivered_moves_nothing(make_session: Make) -> None:
    session = make_session()
    session.manual("ann", {"values": [0.8, 0.5, 0.0]})
    session.not_delivered("ann", "lead came off")
    with pytest.raises(LimitError):
        session.manual("ann", {"values": [1.0, 0.5, 0.0]})
    assert session.state.trials[-1].status == "failed"
    assert session.state.trials[-1].failure == "lead came off"
    session.suggest("ann")


def test_suggestions_expire_when_their_state_is_gone(make_session: Make) -> None:
    session = make_session()
    first = session.suggest("ann")
    session.record("ann", measured(session.manual("ann", near_home())))
    with pytest.raises(ExpiredError, match="suggestion 1 has expired"):
        session.approve("ann", first.number)
    second = session.suggest("ann")
    session.switch_target("ann", "economy")
    for step in (session.approve, lambda who, n: session.refuse(who, "no", n)):
        with pytest.raises(ExpiredError):
            step("ann", second.number)
    third = session.suggest("ann")
    assert third.target == "economy"
    session.stop("ann", "alarm")
    session.resume("ann")
    with pytest.raises(ExpiredError):
        session.approve("ann", third.number)
    session.note("ann", "a remark changes nothing")
    fourth = session.suggest("ann")
    session.note("ann", "nor here")
    session.approve("ann", fourth.number)


def test_nothing_can_be_recorded_for_a_refused_suggestion(make_session: Make) -> None:
    session = make_session()
    suggestion = session.suggest("ann")
    assert refuse_open(session, "looks wrong").decision == "refused"
    with pytest.raises(ProtocolError, match="no trial waits"):
        session.record("ann", Report(values=bowl([0.5, 0.5, 0.0])))
    with pytest.raises(ProtocolError, match="was refused before"):
        session.approve("ann", suggestion.number)
    assert session.suggest("ann").point != suggestion.point


def test_refused_rows_of_a_list_never_come_back(make_session: Make) -> None:
    session = make_session("list")
    refused = []
    for i in range(5):
        refused.append(session.suggest("ann").point)
        refuse_open(session, "no")
        if i == 2:
            session.switch_target("ann", "economy")
    assert len({tuple(p["values"]) for p in refused}) == 5
    session.switch_target("ann", "speed")
    for _ in range(3):
        suggestion = session.suggest("ann")
        assert suggestion.point not in refused
        session.record("ann", measured(approve_open(session)))


def test_modified_and_manual_trials_are_learnt_from(make_session: Make) -> None:
    session = make_session("list")
    suggestion = session.suggest("ann")
    another_row = {"values": [0.6, 0.5, 0.2]}
    trial = session.modify("ann", another_row, "softer", suggestion.number)
    assert (trial.origin, trial.reason, trial.suggestion) == ("modified", "softer", suggestion.number)
    session.record("ann", measured(trial))
    belief = session.believe(another_row)
    assert belief is not None
    assert belief["objective"]["mean"] == pytest.approx(bowl(another_row["values"])["speed"], abs=0.02)
    far = session.believe({"values": [0.2, 0.9, -0.6]})
    assert far is not None
    assert belief["objective"]["sd"] < far["objective"]["sd"]


def test_deciding_twice_is_refused_and_recording_twice_is_one_record(make_session: Make) -> None:
    session = make_session()
    suggestion = session.suggest("ann")
    trial = session.approve("ann", suggestion.number)
    with pytest.raises(ProtocolError, match="was approved before"):
        session.approve("bob", suggestion.number)
    with pytest.raises(ProtocolError, match="waits for its record"):
        session.suggest("ann")
    first = session.record("ann", measured(trial))
    entries = len(session.entries)
    for _ in range(100):
        assert session.record("ann", measured(trial), trial.number) == first
    assert len(session.entries) == entries
    with pytest.raises(ProtocolError, match="another record already, which stays"):
        session.record("ann", Report(values=bowl([0.1, 0.1, 0.0])), trial.number)
    assert session.state.trials[trial.number - 1] == first


def test_a_stopped_session_starts_nothing_but_takes_the_running_record(make_session: Make) -> None:
    session = make_session()
    trial = session.approve("ann", session.suggest("ann").number)
    session.stop("patient", "it hurts")
    session.stop("patient", "it hurts")
    for step in (
        lambda: session.suggest("ann"),
        lambda: session.manual("ann", near_home()),
        lambda: session.approve("ann", 1),
    ):
        with pytest.raises(ProtocolError, match="stopped"):
            step()
    assert session.record("ann", measured(trial)).status == "completed"
    session.resume("ann")
    session.suggest("ann")
    assert [e.kind for e in session.entries].count("resumed") == 1


def test_an_unsafe_trial_without_outcome_is_learnt_from(make_session: Make) -> None:
    session = make_session()
    point = {"values": [0.62, 0.6, 0.1]}
    before = session.believe(point)
    trial = session.manual("ann", point)
    done = session.record("ann", Report(values={"margin": -0.5}))
    assert (done.status, done.outcomes, done.safety) == ("failed", None, {"margin": -0.5})
    after = session.believe(trial.point)
    assert before is not None
    assert after is not None
    assert before["safe_probability"] > 0.9 > 0.1 > after["safe_probability"]


def test_the_optimizer_abstains_rather_than_suggest_what_it_believes_unsafe(make_session: Make) -> None:
    session = make_session(safety=[{"name": "margin", "threshold": 5.0}])
    with pytest.raises(ProtocolError, match="none of the 8 completed trials meets margin >= 5"):
        session.suggest("ann")
    assert session.entries[-1].kind == "abstained"
    session.manual("ann", near_home())


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"speed": 1.0, "economy": 0.0}, "margin missing"),
        ({"speed": 1.0, "margin": 0.0}, "economy missing"),
        ({"speed": float("nan"), "economy": 0.0, "margin": 0.0}, "speed: nan"),
        ({"speed": 1.0, "economy": 0.0, "margin": float("inf")}, "margin: inf"),
        ({"speed": 1.0, "economy": 0.0, "margin": 0.0, "x": 1.0}, "x unknown"),
        ({}, "margin missing"),
    ],
)
def test_bad_values_are_refused_and_the_session_goes_on(
    make_session: Make, values: dict[str, float], message: str
) -> None:
    session = make_session()
    trial = session.approve("ann", session.suggest("ann").number)
    entries = len(session.entries)
    with pytest.raises(RecordingError, match=message):
        session.record("ann", Report(values=values))
    assert len(session.entries) == entries
    assert session.record("ann", measured(trial)).status == "completed"


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ({"values": [0.5, 0.5]}, "2 values, expected 3"),
        ({"values": [0.5, 0.5, float("nan")]}, "c: nan"),
        ({"values": [0.5, 0.5, "x"]}, "'x' is no number"),
        ({"values": [0.5, 0.5, True]}, "True is no number"),
        ({"value": 1}, "a point has values"),
        ({"values": [0.5, 0.5, 1.5]}, "outside the hard limits"),
    ],
)
def test_bad_points_are_refused(make_session: Make, point: dict[str, object], message: str) -> None:
    session = make_session()
    with pytest.raises(LimitError, match=message):
        session.manual("ann", point)


def test_words_are_needed(make_session: Make) -> None:
    session = make_session()
    for who in ("", "   ", "x" * 101, "a\x00b"):
        with pytest.raises(ProtocolError, match="who"):
            session.suggest(who)
    session.suggest("ann")
    with pytest.raises(ProtocolError, match="reason is empty"):
        refuse_open(session, " ")


def test_two_people_cannot_decide_the_same_suggestion(make_session: Make) -> None:
    one = make_session()
    two = Session.open(one.store.directory)
    suggestion = one.suggest("ann")
    two.refresh()
    one.approve("ann", suggestion.number)
    with pytest.raises(ProtocolError, match="was approved before"):
        two.approve("bob", suggestion.number)
    stale = two.state.head
    one.note("ann", "someone was faster")
    with pytest.raises(MovedOnError):
        two.store.append(stale, "bob", "noted", {"text": "late"})


def test_going_on_after_reopening_is_as_if_nothing_had_happened(make_session: Make) -> None:
    straight, broken = make_session(name="one"), make_session(name="two")
    for i in range(5):
        for session in (straight, broken):
            session.suggest("ann")
            if i == 1:
                refuse_open(session, "no")
            else:
                session.record("ann", measured(approve_open(session)))
        broken.close()
        broken = Session.open(broken.store.directory)
        entries = list(broken.entries)
        assert restored_advisor(broken.definition, broken._new_search, broken.cache, entries) is not None
    assert [s.point for s in straight.state.suggestions] == [s.point for s in broken.state.suggestions]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b,c,speed,economy\n", "columns margin are missing"),
        (
            "a,b,c,speed,economy,margin\n.5,.5,0,1,x,0\n",
            "initial.csv, line 2, column economy: 'x' is no finite number",
        ),
        ("a,b,c,speed,economy,margin\n.5,.5,0,1,0,0\n.5,.5,9,1,0,0\n", "line 3: c outside the limits"),
        ("a,b,c,speed,economy,margin\n.5,.5,0,1,0\n", "line 2: 5 values, expected 6"),
        ("a,b,c,speed,economy,margin\n.5,.5,0,1,0,\n", "line 2: .*margin missing"),
        (
            "a,b,c,speed,economy,margin,time\n.5,.5,0,1,0,0,2026-01-02\n.5,.5,0,1,0,0,2026-01-01\n",
            "line 3: .*times out of order",
        ),
        ("a,b,c,speed,economy,margin,more\n", "columns more are unknown"),
        ("", "is empty"),
    ],
)
def test_bad_initial_tables_name_the_line(tmp_path: Path, text: str, message: str) -> None:
    definition, initial = write_box_files(tmp_path)
    initial.write_text(text)
    with pytest.raises(RecordingError, match=message):
        create_session(tmp_path / "s", definition, who="ann", initial=initial)
    assert not (tmp_path / "s").exists()


def test_a_session_that_could_not_work_is_not_made(tmp_path: Path) -> None:
    definition, initial = write_box_files(tmp_path)
    for method, message in (
        ({"name": "magic"}, "magic"),
        ({"name": "sobol"}, "no safe set"),
        ({"name": "scbo"}, "no safe set"),
        ({"name": "hdsafebo_local", "settings": {"alfa": 0.9}}, "alfa"),
        ({"name": "hdsafebo_local", "settings": {"alpha": 1.5}}, "alpha"),
    ):
        write_mapping(definition, box_definition() | {"method": method}, ParamsError)
        with pytest.raises(Exception, match=message):
            create_session(tmp_path / "s", definition, who="ann", initial=initial)
        assert not (tmp_path / "s").exists()
    definition.write_text("!!python/object/apply:os.system ['touch /tmp/owned']")
    with pytest.raises(DefinitionError, match="cannot be read as YAML"):
        create_session(tmp_path / "s", definition, who="ann", initial=initial)


def test_a_directory_holds_one_session(make_session: Make, tmp_path: Path) -> None:
    session = make_session()
    definition, initial = write_box_files(tmp_path)
    with pytest.raises(SessionError, match="already holds a session"):
        create_session(session.store.directory, definition, who="ann", initial=initial)
    with pytest.raises(SessionError, match="no session here"):
        Session.open(tmp_path / "elsewhere")


def test_the_papers_algorithm_runs_over_a_box(make_session: Make) -> None:
    session = make_session(method={"name": "hdsafebo", "settings": {"beta": -1.0}})
    for _ in range(4):
        trial = session.approve("ann", session.suggest("ann").number)
        assert not session.space.breaches(trial.point, session.state.last_point)
        session.record("ann", measured(trial))


def test_numbers_are_whole_and_may_be_numpys(make_session: Make) -> None:
    session = make_session()
    session.suggest("ann")
    for number in (True, 1.0, "1", None, np.float64(1)):
        for step in (
            lambda n: session.approve("ann", n),
            lambda n: session.refuse("ann", "no", n),
            lambda n: session.modify("ann", {"values": [0.5, 0.5, 0.0]}, "why", n),
        ):
            with pytest.raises(ProtocolError, match=r"suggestion is .*, expected its number"):
                step(number)
    trial = session.approve("ann", np.int64(1))
    with pytest.raises(ProtocolError, match=r"trial is 9\.0, expected its number"):
        session.record("ann", measured(trial), float(trial.number))  # type: ignore[arg-type]
    assert session.record("ann", measured(trial), np.int64(trial.number)).status == "completed"


def test_what_no_log_can_hold_is_refused_in_words() -> None:
    """The path of a session file need not be UTF-8."""
    with pytest.raises(SessionError, match=r"log entry 1 \(noted\): cannot be written"):
        seal(1, "2026-01-01T00:00:00+00:00", "ann", "noted", {"text": "\udcff"}, START)


def test_an_input_called_as_a_column_of_the_tables_is_exported_beside_it(tmp_path: Path) -> None:
    """An input `target` stood in the column of the objective, and one called `reason` in none."""
    definition, initial = write_box_files(tmp_path)
    names = {"a": "target", "b": "reason", "c": "outcome_speed"}
    data = box_definition()
    for item in data["inputs"]:
        item["name"] = names[item["name"]]
    write_mapping(definition, data, ParamsError)
    initial.write_text(initial.read_text().replace("a,b,c", ",".join(names.values()), 1))
    session = create_session(tmp_path / "s", definition, who="ann", initial=initial)
    session.suggest("ann")
    folder = tmp_path / "out"
    export_session(session, folder)
    values = np.array([t.point["values"] for t in session.state.trials])
    for table in (pd.read_csv(folder / "trials.csv"), pd.read_parquet(folder / "trials.parquet")):
        assert set(table["target"].dropna()) <= {"speed"}, "of initial trials there is none"
        np.testing.assert_array_equal(table[[f"input_{n}" for n in names.values()]], values)
    suggestions = pd.read_csv(folder / "suggestions.csv")
    assert suggestions.columns.tolist()[:6] == [
        "suggestion",
        "target",
        "decision",
        "input_target",
        "reason",
        "outcome_speed",
    ]
