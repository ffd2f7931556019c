"""A trial recorded from a stream on the command line; the values are asked for when the trial is over."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdsafebo.cli import main
from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import write_mapping
from hdsafebo.session.create import create_session
from hdsafebo.session.session import Session
from hdsafebo.session.stream_option import add_stream_options
from tests.session.measuring.outlets import Amplifier
from tests.session.small import small_definition


@pytest.fixture
def bench(tmp_path: Path, initial_trials: str, monkeypatch: pytest.MonkeyPatch) -> Session:
    """A session whose trigger is a channel, with a running trial; the working directory is its parent."""
    data = small_definition()
    data["emg"]["trigger"] = {"channel": "TRIG", "threshold": 2.5}
    write_mapping(tmp_path / "session.yaml", data, ParamsError)
    (tmp_path / "initial.csv").write_text(initial_trials)
    session = create_session(
        tmp_path / "s", tmp_path / "session.yaml", who="ann", initial=tmp_path / "initial.csv"
    )
    polarity = [0] * 16
    polarity[3], polarity[4] = -1, 1
    session.manual("ann", {"polarity": polarity, "current_ma": 0.1}, "our usual one")
    monkeypatch.chdir(tmp_path)
    return session


def amplifier(muscles: list[str]) -> Amplifier:
    """A trial: a response of 40 uV times the muscle's number to each of 8 pulses, which a channel marks."""
    t = np.arange(2000) / 2000
    since = (t % 0.1) * (t < 0.8)
    response = np.where((since >= 0.01) & (since < 0.02), 20.0, -20.0)[:, None] * np.arange(1, 9)
    trigger = np.where((t < 0.8) & (t % 0.1 < 0.003), 5.0, 0.0)
    return Amplifier(np.c_[response, trigger], [*muscles, "TRIG"], ["uV"] * 8 + ["V"])


def record(*words: str) -> None:
    main(["session", "record", "s", "--who", "ann", "--trial", "133", *words])


def deliver_when_asked(monkeypatch: pytest.MonkeyPatch, device: Amplifier, answers: list[str]) -> list[str]:
    """Deliver when the program says so, and answer what it asks; returns all that it says."""
    said: list[str] = []

    def hear(*words: Any, **_: Any) -> None:
        said.append(" ".join(map(str, words)))
        if "deliver the trial now" in said[-1]:
            device.deliver()

    def answer(question: str) -> str:
        said.append(question)
        if not answers:
            raise EOFError
        return answers.pop(0)

    monkeypatch.setattr("builtins.print", hear)
    monkeypatch.setattr("builtins.input", answer)
    return said


def test_a_trial_is_recorded_from_a_stream(bench: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    muscles = list(bench.space.targets)
    with amplifier(muscles) as device:
        said = deliver_when_asked(monkeypatch, device, ["many", "7"])
        record("--stream", "EMG", "--seconds", "1.5", "patient=8", "ask")
    assert [word for word in said if word.endswith(": ")] == ["therapist: ", "therapist: "]
    bench.refresh()
    trial = bench.state.trials[-1]
    assert trial.status == "completed"
    assert trial.safety == {"score": 7.0}
    np.testing.assert_allclose(trial.details["mu"], 40.0 * np.arange(1, 9) / 800.0)
    kept = Path("trial133.csv").read_bytes()
    assert bench.store.attachments.content(trial.details["recording"]["sha256"]) == kept


def test_a_recording_outlives_a_record_that_fails(
    bench: Session, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nobody answers, and the scores come later: with the file, which is never written over."""
    with amplifier(list(bench.space.targets)) as device:
        said = deliver_when_asked(monkeypatch, device, [])
        with pytest.raises(SystemExit):
            record("--stream", "EMG", "--seconds", "1.5", "patient=8", "ask")
        kept = Path("trial133.csv").read_bytes()
        with pytest.raises(SystemExit):
            record("--stream", "EMG", "patient=8", "ask")
    assert Path("trial133.csv").read_bytes() == kept
    assert "deliver" in " ".join(said)
    bench.refresh()
    assert bench.state.running is not None
    record("--recording", "trial133.csv", "patient=8", "therapist=6")
    bench.refresh()
    assert bench.state.trials[-1].safety == {"score": 6.0}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--stream", "EMG", "--recording", "a.csv", "ask"],
            "--stream and --recording: expected one of them",
        ),
        (["--stream", "EMG", "--trial", "5", "ask"], "that trial is not running"),
        (["--stream", "EMG", "patient=8"], "therapist missing: expected NAME=VALUE, or `ask`"),
        (["--stream", "absent", "ask"], "no stream is named 'absent'"),
        (["--stream", "EMG", "--seconds", "0", "ask"], "expected more than 0"),
        (["--recording", "/dev/zero", "patient=8", "therapist=8"], "is no regular file"),
    ],
)
def test_what_cannot_be_is_said(
    bench: Session, words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        record(*words)
    assert message in capsys.readouterr().err
    assert not list(Path.cwd().glob("trial*.csv"))


@pytest.mark.parametrize("text", ["1_0", "nan", "inf", "\u0662", "two"])
def test_seconds_are_a_plain_number(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    add_stream_options(parser)
    assert parser.parse_args(["--seconds", "1.5"]).seconds == 1.5
    with pytest.raises(SystemExit):
        parser.parse_args(["--seconds", text])
    assert "--seconds: invalid number value" in capsys.readouterr().err
