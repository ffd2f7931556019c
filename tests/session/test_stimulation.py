"""The clinical session on the simulated patient: envelope, scores, recordings, the month in small."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import read_mapping, write_mapping
from hdsafebo.session.candidates.stimulation_set import SessionStimulationSet, enumerate_polarities
from hdsafebo.session.create import create_session
from hdsafebo.session.definition import StimulationDefinition, parse_definition
from hdsafebo.session.errors import LimitError, ProtocolError, RecordingError
from hdsafebo.session.measuring.emg import selectivity
from hdsafebo.session.patient.month import (
    answer,
    run_month,
    simulated_patient,
)
from hdsafebo.session.patient.month_result import count_breaches, evaluate_month
from hdsafebo.session.patient.patient import SimulatedPatient
from hdsafebo.session.patient.responses import Responses
from hdsafebo.session.session import Session
from hdsafebo.session.spaces.space import Report
from hdsafebo.session.spaces.stimulation import StimulationSpace, arrays
from hdsafebo.session.views.audit import replay
from hdsafebo.session.views.slices import slices
from hdsafebo.spinal.configurations import enumerate_configurations
from tests.session.measuring.test_stimulator import allowed_by_hand
from tests.session.small import CURRENTS_MA, FakeClock, approve_open, refuse_open, small_definition

Clinic = tuple[Session, SimulatedPatient]


@pytest.fixture
def clinic(tmp_path: Path, responses: Responses, clinic_files: tuple[Path, Path]) -> Clinic:
    """A session and its simulated patient."""
    definition, initial = clinic_files
    session = create_session(tmp_path / "s", definition, who="ann", initial=initial, clock=FakeClock())
    return session, simulated_patient(session, responses, 1)


def test_priors_of_the_paper_give_its_set() -> None:
    data = small_definition()
    data["priors"]["poles"] = [{"cathodes": 1, "anodes": [1, 2, 3]}, {"cathodes": 2, "anodes": [1, 2]}]
    definition = parse_definition(data)
    assert isinstance(definition, StimulationDefinition)
    found = enumerate_polarities(definition.priors)
    assert {tuple(row) for row in found.tolist()} == {
        tuple(row) for row in enumerate_configurations().tolist()
    }


def test_the_month_in_small(clinic: Clinic) -> None:
    session, patient = clinic
    assert len(session.state.trials) == 132
    run_month(session, patient, trials=40)
    assert [e.payload["target"] for e in session.entries if e.kind == "target_switched"] == list(
        session.space.targets[1:]
    )
    assert sum(e.kind == "resumed" for e in session.entries) == 1  # the second day
    result = evaluate_month(session, patient)
    assert result.breaches == 0
    assert result.recommended + sum(t.origin == "manual" for t in session.state.trials) == 40
    assert result.unsafe <= 1
    before = [s.point for s in session.state.suggestions]
    run_month(session, patient, trials=40)  # nothing is left to do
    assert [s.point for s in session.state.suggestions] == before
    assert replay(session) == []


def test_what_is_measured_is_what_the_patient_shows(clinic: Clinic) -> None:
    """Noise apart, selectivity computed from the recording is that of the patient's true activation."""
    session, patient = clinic
    ratios = []
    for trial in session.state.trials:
        if trial.outcomes is not None:
            truth = selectivity(patient.activation(trial.point))
            ratios.append(np.array(list(trial.outcomes.values())) / truth)
    assert np.median(ratios) == pytest.approx(1.0, abs=0.1)


def test_broken_contacts_and_priors_bind_every_suggestion(
    tmp_path: Path, clinic_files: tuple[Path, Path]
) -> None:
    definition, initial = clinic_files
    data = read_mapping(definition, ParamsError)
    data["stimulator"]["impedance_ohm"][3] = 9000.0
    write_mapping(definition, data, ParamsError)
    session = create_session(tmp_path / "s", definition, who="ann", initial=initial)
    for _ in range(5):
        point = session.suggest("ann").point
        assert point["polarity"][3] == 0
        assert sorted(p for p in point["polarity"] if p) == [-1, 1]
        assert point["current_ma"] <= 0.15
        refuse_open(session, "only looking")
    with pytest.raises(LimitError, match="impedance of a contact is 9000 ohm"):
        session.manual("ann", session.space.parse("4- 5+ at 0.1 mA", None))


def random_proposals(n: int, data: dict[str, object]) -> int:
    """Breaches among n random rows and decoded points, each after a random last trial."""
    definition = parse_definition(data)
    assert isinstance(definition, StimulationDefinition)
    space = StimulationSpace(definition)
    rows = SessionStimulationSet(definition.priors, space.envelope, as_maps=True)
    rng = np.random.default_rng(0)
    breaches = done = 0
    taken: list[int] = []
    while done < n:
        last = None if rng.random() < 0.2 else rows.point(int(rng.integers(rows.size)))
        forbidden = np.union1d(rows.forbidden(last), np.array(taken[-50:], np.int64))
        maps = (
            rng.uniform(rows.bounds[0], rows.bounds[1], (20, rows.bounds.shape[1]))
            if done % 40
            else 1 - rng.random((20, 728))
        )
        found = rows.nearest(maps, forbidden)
        points = [rows.point(int(row)) for row in found]
        polarity, current = arrays(points)
        last_ma = None if last is None else last["current_ma"]
        breaches += sum(
            not allowed_by_hand(r, float(c), last_ma, space.envelope)
            for r, c in zip(polarity, current, strict=True)
        )
        breaches += len(np.intersect1d(found, forbidden)) + (len(set(found.tolist())) < len(found))
        taken += found.tolist()
        done += len(found)
    return breaches


def test_decoded_proposals_never_leave_the_envelope() -> None:
    assert random_proposals(1000, small_definition()) == 0


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_hundred_thousand_decoded_proposals_never_leave_the_envelope() -> None:
    assert random_proposals(100_000, small_definition()) == 0


def test_scores_and_recordings_are_checked_and_the_session_goes_on(clinic: Clinic) -> None:
    session, patient = clinic
    trial = session.approve("ann", session.suggest("ann").number)
    number, response = answer(session, patient)
    assert number == trial.number
    assert response.recording is not None
    recording = (response.recording, "trial.csv")
    good = dict(response.scores)
    cases = [
        (Report(recording, good | {"patient": 11.0}), "score of patient is 11, expected 0 to 10"),
        (Report(recording, good | {"therapist": -1.0}), "score of therapist is -1"),
        (Report(recording, {"patient": 8.0}), "scores of therapist missing"),
        (Report(recording, good | {"nurse": 8.0}), "scores of nurse unknown"),
        (Report((response.recording[: len(response.recording) // 2], "trial.csv"), good), "trial.csv"),
        (
            Report((response.recording.replace(b"session: ", b"session: x"), "trial.csv"), good),
            "says it is of session 'x",
        ),
        (
            Report((response.recording.replace(b"# trial: ", b"# trial: 9"), "trial.csv"), good),
            "says it is of trial '9",
        ),
    ]
    entries = len(session.entries)
    for report, message in cases:
        with pytest.raises(RecordingError, match=message):
            session.record("ann", report)
    assert len(session.entries) == entries
    done = session.record("ann", Report(recording, good))
    assert done.safety == {"score": min(good.values())}
    session.manual("ann", session.space.parse("1- 2+ at 0.05 mA", None))
    unlabelled = b"time_s" + response.recording.split(b"time_s")[1]
    for content in (unlabelled, b"# a remark: 1\n" + unlabelled, unlabelled + b"\n"):
        with pytest.raises(RecordingError, match="belongs to trial 133 already"):
            session.record("ann", Report((content, "again.csv"), good))
    again = session.record("ann", Report((b"# a remark: 1\n" + unlabelled, "again.csv"), good), done.number)
    assert again == done  # the same samples for the same trial: recorded already
    session.record("ann", Report(values=good))


def test_a_slice_runs_along_the_current(clinic: Clinic) -> None:
    session, _ = clinic
    line = slices(session, session.state.trials[0])[0]
    assert line.name == "current_ma"
    assert line.beliefs[-1].at == session.space.envelope.limits.max_current_ma
    assert all(0.0 <= b.safe_probability <= 1.0 and b.deviation > 0 for b in line.beliefs)


def test_a_missing_recording_keeps_the_scores(clinic: Clinic) -> None:
    session, _ = clinic
    point = session.space.parse("1- 2+ at 0.05 mA", None)
    before = session.believe(point)
    session.manual("ann", point)
    trial = session.record("ann", Report(values={"patient": 2.0, "therapist": 8.0}))
    assert (trial.status, trial.outcomes, trial.safety) == ("failed", None, {"score": 2.0})
    after = session.believe(trial.point)
    assert before is not None
    assert after is not None
    assert after["safety"]["score"]["mean"] < before["safety"]["score"]["mean"]


def test_no_current_above_an_unsafe_one_is_suggested_for_the_same_contacts(clinic: Clinic) -> None:
    session, _ = clinic
    point = session.suggest("ann").point
    trial = approve_open(session)
    session.record("ann", Report(values={"patient": 0.0, "therapist": 9.0}))
    search = session.search()
    rows = search.beyond(trial.point)
    assert [search.point_of(np.empty(0), int(r)) for r in rows] == [
        point | {"current_ma": c} for c in CURRENTS_MA if c >= point["current_ma"]
    ]
    assert set(rows.tolist()) <= set(session.advisor()._declined().tolist())
    for _ in range(3):
        following = session.suggest("ann").point
        assert not (
            following["polarity"] == point["polarity"] and following["current_ma"] >= point["current_ma"]
        )
        refuse_open(session, "only looking")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1- 2+", "expected contacts"),
        ("at 1 mA", "expected contacts"),
        ("1- 17+ at 1 mA", "'17\\+'"),
        ("1- 1+ at 1 mA", "'1\\+'"),
        ("1- 2+ at one mA", "current 'one'"),
        ("1* at 1 mA", "'1\\*'"),
    ],
)
def test_stimulations_are_read_as_they_are_written(clinic: Clinic, text: str, message: str) -> None:
    space = clinic[0].space
    point = space.parse("4- 12+ 13+ at 0.25 mA", None)
    assert space.parse(space.describe(point), None) == point
    assert space.parse("at 0.5 mA", point) == point | {"current_ma": 0.5}
    assert space.parse("1- 2+", point)["current_ma"] == 0.25
    with pytest.raises(LimitError, match=message):
        space.parse(text, None)


def edited(row: int, first: int, cells: list[str]) -> Callable[[str], str]:
    """Replaces cells of one line of a table."""

    def edit(text: str) -> str:
        lines = [line.split(",") for line in text.split("\n")]
        lines[row][first : first + len(cells)] = cells
        return "\n".join(",".join(line) for line in lines)

    return edit


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (edited(0, 15, ["e17"]), "columns e16 are missing"),
        (edited(1, 0, ["2"]), "line 2: polarity of contact 1 is 2"),
        (edited(1, 27, ["0"]), "line 2: 28 values, expected 27"),
        (edited(3, 26, ["12"]), "line 4: score of therapist is 12"),
        (edited(3, 25, [""]), "line 4, column score_patient: is empty"),
        (edited(2, 18, [""]), "line 3: some of mu_IL_left"),
        (edited(2, 17, ["-0.1"]), "line 3: mu is negative"),
        (edited(5, 0, ["0"] * 16), "line 6: no cathode"),
    ],
)
def test_bad_initial_tables_name_the_line(
    tmp_path: Path, clinic_files: tuple[Path, Path], change: Callable[[str], str], message: str
) -> None:
    definition, initial = clinic_files
    initial.write_text(change(initial.read_text()))
    with pytest.raises(RecordingError, match=message):
        create_session(tmp_path / "s", definition, who="ann", initial=initial)


def test_a_method_of_codes_needs_an_embedding(tmp_path: Path, clinic_files: tuple[Path, Path]) -> None:
    definition, initial = clinic_files
    data = read_mapping(definition, ParamsError) | {
        "method": {"name": "hdsafebo", "settings": {"beta": -1.0}}
    }
    write_mapping(definition, data, ParamsError)
    session = create_session(tmp_path / "s", definition, who="ann", initial=initial)
    with pytest.raises(Exception, match="give it an embedding"):
        session.suggest("ann")


def test_the_papers_way_through_an_embedding(
    tmp_path: Path, responses: Responses, clinic_files: tuple[Path, Path]
) -> None:
    """hdsafebo over PCA codes of field maps, decoded to the nearest permitted configuration not yet tried."""
    from hdsafebo.embeddings import make_embedding

    definition, initial = clinic_files
    data = read_mapping(definition, ParamsError) | {"method": {"name": "hdsafebo", "settings": {"beta": 0.0}}}
    write_mapping(definition, data, ParamsError)
    parsed = parse_definition(data)
    assert isinstance(parsed, StimulationDefinition)
    rows = SessionStimulationSet(parsed.priors, StimulationSpace(parsed).envelope, as_maps=True)
    maps = rows.inputs(np.arange(0, rows.size))
    embedding = tmp_path / "pca.safetensors"
    make_embedding("pca", latent_dim=8).fit(maps, rng=np.random.default_rng(0)).save(embedding)
    session = create_session(tmp_path / "s", definition, who="ann", initial=initial, embedding=embedding)
    patient = simulated_patient(session, responses, 1)
    tried = {session.space.describe(t.point) for t in session.state.trials}
    made = 0
    for _ in range(4):
        try:
            trial = session.approve("ann", session.suggest("ann").number)
        except ProtocolError:
            break  # it may abstain, but it must not suggest anything else
        made += 1
        assert session.space.describe(trial.point) not in tried
        assert trial.point["current_ma"] in CURRENTS_MA
        tried.add(session.space.describe(trial.point))
        _, response = answer(session, patient)
        recording = None if response.recording is None else (response.recording, "trial.csv")
        session.record("ann", Report(recording, response.scores))
    assert made >= 1
    assert count_breaches(session) == 0
    assert replay(session) == []
