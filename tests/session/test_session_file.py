"""A session file that asks for more care than is in force is never ignored in silence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import read_mapping, write_mapping
from hdsafebo.session.create import create_session
from hdsafebo.session.errors import DefinitionError
from hdsafebo.session.session import Session
from tests.session.small import small_definition

Make = Callable[..., Session]
Change = Callable[[dict[str, Any]], object]
HOME = {"values": [0.5, 0.5, 0.0]}
LOW = {"polarity": [-1, 1, *[0] * 14], "current_ma": 0.05}
FREE = [{"name": n, "lower": -1.0, "upper": 1.0} for n in "abc"]
LIMIT = [{"name": "margin", "at_most": 1.0}]
AT_ONCE = {"inputs": FREE, "at_once": 3}
BETA = {"method": {"settings": {"beta": -3.0}}}
MORE: dict[str, tuple[dict[str, Any], Change, str]] = {
    "a step": ({"inputs": FREE}, lambda d: d["inputs"][0].update(max_step=0.1, home=0.5), "max_step is 0.1"),
    "a start": ({}, lambda d: d["inputs"][0].update(home=0.4), r"inputs\.0\.home is 0\.4"),
    "a threshold": ({}, lambda d: d["safety"][0].update(threshold=0.1), r"at_least is 0\.1, in force 0\.0"),
    "an upper limit": ({"safety": LIMIT}, lambda d: d["safety"][0].update(at_most=0.5), "at_most is 0.5"),
    "a limited quantity": ({}, lambda d: d["safety"].append({"name": "heat", "at_most": 1}), "heat"),
    "fewer at once": (AT_ONCE, lambda d: d.update(at_once=1), "at_once is 1, in force 3"),
    "a promise": ({}, lambda d: d.update(method={"settings": {"alpha": 0.999}}), "alpha is 0.999"),
    "a lower bound": (BETA, lambda d: d["method"]["settings"].update(beta=-4.0), "beta is -4.0, in force -3"),
    "an input": ({}, lambda d: d["inputs"].append({"name": "d", "lower": 0, "upper": 1}), "'d'"),
    "a limit and a seed": (
        {},
        lambda d: (d["inputs"][0].update(upper=0.9), d.update(seed=7)),
        "upper is 0.9",
    ),
    "a wrong key": ({}, lambda d: d["inputs"][0].update(uper=0.6), "uper: unknown key"),
    "a limit that leaves the start outside": (
        {},
        lambda d: d["inputs"][0].update(upper=0.45),
        "lower <= home",
    ),
    "a limit with its unit": ({}, lambda d: d["inputs"][0].update(upper="0.6 V"), "valid number"),
}
MORE_CLINIC: dict[str, tuple[Change, str]] = {
    "wider pulses": (lambda d: d["stimulator"].update(pulse_width_us=900.0), "pulse_width_us is 900"),
    "smaller contacts": (lambda d: d["stimulator"].update(contact_area_mm2=0.1), "contact_area_mm2 is 0.1"),
    "one contact": (
        lambda d: d["stimulator"].update(current_split="single_contact"),
        "current_split is 'single_contact'",
    ),
    "a higher score": (lambda d: d["scores"].update(threshold=9.5), r"threshold is 9\.5"),
    "another rater": (lambda d: d["scores"]["raters"].append("nurse"), "nurse"),
    "fewer currents": (lambda d: d["priors"]["currents_ma"].pop(), "currents_ma"),
    "an impedance": (lambda d: d["stimulator"]["impedance_ohm"].__setitem__(3, 9e4), r"impedance_ohm\.3"),
}


def edit(session: Session, change: Change) -> Path:
    path = Path(session.state.source)
    data = read_mapping(path, ParamsError)
    change(data)
    write_mapping(path, data, ParamsError)
    return path


@pytest.mark.parametrize("name", MORE)
def test_nothing_starts_while_the_file_asks_for_more_care(make_session: Make, name: str) -> None:
    changes, change, message = MORE[name]
    session = make_session(**changes)
    before = Path(session.state.source).read_text()
    path = edit(session, change)
    for step in (lambda: session.manual("ann", HOME), lambda: session.suggest("ann")):
        with pytest.raises(DefinitionError, match=message):
            step()
    assert len(session.entries) == 1
    path.write_text(before)
    session.manual("ann", HOME)


@pytest.mark.parametrize("name", MORE_CLINIC)
def test_nothing_is_delivered_while_the_file_asks_for_more_care(tmp_path: Path, name: str) -> None:
    change, message = MORE_CLINIC[name]
    data = small_definition()
    data["stimulator"]["current_split"] = "equal"
    write_mapping(tmp_path / "session.yaml", data, ParamsError)
    session = create_session(tmp_path / "s", tmp_path / "session.yaml", who="ann")
    edit(session, change)
    with pytest.raises(DefinitionError, match=message):
        session.manual("ann", LOW)


@pytest.mark.parametrize(
    "content", [b"kind: box\ninputs: [{name: a, lower: 0, upper: 0.4", b"\xff\xfe", b"- 1\n"]
)
def test_a_file_that_cannot_be_read_as_one_is_not_taken_for_wider(make_session: Make, content: bytes) -> None:
    session = make_session()
    Path(session.state.source).write_bytes(content)
    with pytest.raises(DefinitionError, match="correct it, or move it away"):
        session.manual("ann", HOME)
    Path(session.state.source).unlink()
    session.manual("ann", HOME)


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["inputs"][0].update(upper=2.0, max_step=0.9),
        lambda d: [i.pop(k) for i in d["inputs"] for k in ("max_step", "home")],
        lambda d: d["safety"][0].update(threshold=-0.1),
        lambda d: d.update(safety=[{"name": "margin", "at_least": 0.0}]),
        lambda d: d.update(target="economy", seed=9),
        lambda d: (d["inputs"][0].update(upper=0.6), d.update(name="the next one")),
    ],
    ids=["wider", "no steps", "a lower threshold", "its newer name", "target and seed", "another session"],
)
def test_what_asks_for_no_more_care_keeps_nothing_from_starting(make_session: Make, change: Change) -> None:
    session = make_session()
    edit(session, change)
    session.manual("ann", HOME)


def test_a_higher_bound_asks_for_no_more_care(make_session: Make) -> None:
    session = make_session(**BETA)
    edit(session, lambda d: d["method"]["settings"].update(beta=-2.0))
    session.manual("ann", HOME)


def test_rows_that_were_taken_out_of_a_list_keep_trials_from_starting(make_session: Make) -> None:
    session = make_session("list")
    path = Path(session.state.source).parent / "candidates.csv"
    header, *rows = path.read_text().splitlines()
    path.write_text(
        "\n".join([header, *reversed(rows), "0.55,0.5,0.0"]) + "\n"
    )  # another order, and one more
    session.manual("ann", HOME)
    session.not_delivered("ann", "only trying")
    path.write_text("\n".join([header, *rows[1:]]) + "\n")
    with pytest.raises(DefinitionError, match="1 rows were taken out"):
        session.manual("ann", HOME)
    path.write_text("a,b\n1,2\n")
    with pytest.raises(DefinitionError, match="columns c are missing"):
        session.manual("ann", HOME)
    path.unlink()
    session.manual("ann", HOME)
