"""The method for trials one at a time: safe by the model, the best of it found, the same when reopened."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import ParamsError, ProblemError
from hdsafebo.files.yaml import write_mapping
from hdsafebo.session.advice.shortlist import HdSafeBOShortlist
from hdsafebo.session.create import create_session
from hdsafebo.session.session import Session
from hdsafebo.session.views.audit import replay
from hdsafebo.session.views.summary import promised
from tests.session.small import bowl, box_definition, measured, write_box_files

METHOD = {
    "name": "hdsafebo_shortlist",
    "settings": {"every": 3, "shortlist": 40, "elsewhere": 20, "alpha": 0.99},
}


def test_it_climbs_within_the_safe_set(make_session: Callable[..., Session]) -> None:
    session = make_session("list", method=METHOD)
    start = session.best()
    points = []
    for _ in range(20):
        trial = session.approve("ann", session.suggest("ann").number)
        assert (trial.belief or {})["safe_probability"] >= 0.99
        session.record("ann", measured(trial))
        points.append(tuple(trial.point["values"]))
    assert len(set(points)) == 20
    best = session.best()
    assert start is not None
    assert best is not None
    assert (best.outcomes or {})["speed"] > (start.outcomes or {})["speed"]
    assert sum(bowl(p)["margin"] < 0 for p in points) <= 1
    assert (best.outcomes or {})["speed"] >= 0.98
    assert promised(session)["alpha"] == pytest.approx(0.99)


def test_reopened_it_goes_on_with_the_same_shortlist(make_session: Callable[..., Session]) -> None:
    """Reopened after every step, between two shortlists and across a new one, and replayed."""
    session = make_session("list", method=METHOD)
    directory = session.store.directory
    for _ in range(8):
        trial = session.approve("ann", session.suggest("ann").number)
        session.record("ann", measured(trial))
        session.close()
        session = Session.open(directory)
    assert replay(session) == []


def test_hyperparameters_are_searched_every_few_trials(make_session: Callable[..., Session]) -> None:
    """Each saved fit counts the searches behind it; 12 trials hold 4 multiples of 3."""
    session = make_session("list", method=METHOD)
    lengths = []
    for _ in range(12):
        session.record("ann", measured(session.approve("ann", session.suggest("ann").number)))
        session.suggest("ann")
        optimizer = session.advisor()._require()
        assert isinstance(optimizer, HdSafeBOShortlist)
        assert optimizer.refines() == (int(optimizer.trials.completed.sum()) % 3 == 0)
        lengths.append(optimizer.surrogate.safety[0].length_scale)
    changed = np.flatnonzero(~np.isclose(np.diff(lengths), 0.0, rtol=0.0, atol=1e-9))
    assert 1 <= len(changed) <= 4


def test_it_needs_a_finite_set(tmp_path: Path) -> None:
    definition, initial = write_box_files(tmp_path)
    write_mapping(definition, box_definition() | {"method": METHOD}, ParamsError)
    with pytest.raises(ProblemError, match="searches the finite set of a session"):
        create_session(tmp_path / "s", definition, who="ann", initial=initial)


def test_taken_rows_are_those_of_every_optimizer(make_session: Callable[..., Session]) -> None:
    session = make_session("list", method=METHOD)
    session.suggest("ann")
    optimizer = session.advisor()._require()
    assert isinstance(optimizer, HdSafeBOShortlist)
    np.testing.assert_array_equal(optimizer.taken, super(HdSafeBOShortlist, optimizer).taken)
