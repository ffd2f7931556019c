"""Slices through the trial believed best: what the model says along each input, in words and pictures."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from hdsafebo.session.create import create_session
from hdsafebo.session.session import Session
from hdsafebo.session.views.audit import replay
from hdsafebo.session.views.believed import believed_best
from hdsafebo.session.views.plots import slice_svg
from hdsafebo.session.views.report import write_report
from hdsafebo.session.views.slices import POINTS, slices
from tests.session.small import approve_open, measured, write_box_files


def small_session(folder: Path, kind: str) -> Session:
    """A session of a box or a list with two recorded trials."""
    definition, initial = write_box_files(folder / "files", kind)
    session = create_session(folder / "session", definition, who="ann", initial=initial)
    for _ in range(2):
        session.suggest("ann")
        session.record("ann", measured(approve_open(session)))
    return session


@pytest.mark.parametrize("kind", ["box", "list"])
def test_slices_say_what_the_model_believes_along_each_input(tmp_path: Path, kind: str) -> None:
    session = small_session(tmp_path, kind)
    trial = believed_best(session, ["speed"])["speed"].trial
    lines = slices(session, trial)
    assert [line.name for line in lines] == ["a", "b", "c"]
    values = trial.point["values"]
    for j, line in enumerate(lines):
        assert line.centre == values[j]
        assert len(line.beliefs) == POINTS
        assert (line.beliefs[0].at, line.beliefs[-1].at) == ((0.0, 1.0) if j < 2 else (-1.0, 1.0))
        middle = line.beliefs[POINTS // 3]
        point = {"values": [*values[:j], middle.at, *values[j + 1 :]]}
        believed = session.believe(point)
        assert believed is not None
        assert middle.mean == pytest.approx(believed["objective"]["mean"], abs=1e-9)
        assert middle.deviation == pytest.approx(believed["objective"]["sd"], abs=1e-9)
        assert middle.safe_probability == pytest.approx(believed["safe_probability"], abs=1e-9)
        assert len(line.trials) == len(session.state.trials)
    session.suggest("ann")
    assert replay(session) == [], "looking changes no suggestion"


def test_slices_keep_to_the_limits_in_force(tmp_path: Path) -> None:
    session = small_session(tmp_path, "box")
    tighter = session.definition.model_copy(deep=True)
    tighter.inputs[0].__dict__["upper"] = 0.8
    session.space.tighten(tighter)
    line = slices(session, session.state.trials[0])[0]
    assert line.beliefs[-1].at == 0.8


def test_the_report_draws_them(tmp_path: Path) -> None:
    session = small_session(tmp_path, "box")
    page = write_report(session, tmp_path / "report.html").read_text()
    assert page.count('aria-label="slice along ') == 3
    best = believed_best(session, ["speed"])["speed"].trial
    drawn = ElementTree.fromstring(slice_svg(slices(session, best)[0]))
    dots = [e for e in drawn if e.tag.endswith("circle")]
    assert len(dots) == len(session.state.trials)


def test_without_data_nothing_is_drawn(tmp_path: Path) -> None:
    definition, _ = write_box_files(tmp_path / "files")
    session = create_session(tmp_path / "session", definition, who="ann")
    page = write_report(session, tmp_path / "report.html").read_text()
    assert "Nothing is believed yet." in page
