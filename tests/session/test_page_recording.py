"""The page with a recording that is corrected on the disk while it is chosen."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from hdsafebo.session.create import create_session
from hdsafebo.session.patient.month import answer, simulated_patient
from hdsafebo.session.patient.responses import Responses
from hdsafebo.session.session import Session
from tests.session.browser import Browser, wait_for
from tests.session.test_page import Served, needs_browser


@pytest.fixture
def clinic(tmp_path: Path, clinic_files: tuple[Path, Path]) -> Iterator[tuple[Session, Served]]:
    """A session with a running trial of one's own, and its page."""
    definition, initial = clinic_files
    session = create_session(tmp_path / "s", definition, who="ann", initial=initial)
    polarity = [0] * 16
    polarity[3], polarity[4] = -1, 1
    session.manual("ann", {"polarity": polarity, "current_ma": 0.1}, "our usual one")
    served = Served(tmp_path / "s")
    yield session, served
    served.stop()
    session.close()


def written(path: Path, content: bytes, later_s: int) -> None:
    """Write a file some seconds later than the last time, by the clock of the disk."""
    path.write_bytes(content)
    status = path.stat()
    os.utime(path, (status.st_atime + later_s, status.st_mtime + later_s))


@needs_browser
def test_a_corrected_recording_is_sent_when_record_is_pressed_again(
    clinic: tuple[Session, Served], responses: Responses, tmp_path: Path
) -> None:
    session, served = clinic
    _, response = answer(session, simulated_patient(session, responses, 1))
    whole = response.recording
    assert whole is not None
    recording = tmp_path / "trial133.csv"
    written(recording, whole[:1000], 0)
    with Browser(tmp_path / "profile") as browser:
        browser.open(served.address)
        wait_for(lambda: browser.text("#title").startswith("Trial 133"), "the trial")
        browser.type("#who", "Ann")
        browser.type("#file", str(recording))
        for rater in ("patient", "therapist"):
            browser.type(f"#entries input[name={rater}]", "8")
        browser.click("button[data-step=Record]")
        wait_for(lambda: "trial133.csv" in browser.text("#message"), "the refusal of a cut recording")
        written(recording, whole.replace(b"IL_left", b"IL_wrong", 1), 5)
        browser.click("button[data-step=Record]")
        wait_for(lambda: "IL_left are missing" in browser.text("#message"), "the refusal of what it is now")
        written(recording, whole, 10)
        browser.click("button[data-step=Record]")
        wait_for(lambda: "choose it again" in browser.text("#message"), "the word that it has changed")
        browser.type("#file", str(recording))
        browser.click("button[data-step=Record]")
        wait_for(lambda: browser.text("#title") == "Ready", "the record")
    session.refresh()
    assert session.state.trials[-1].details["recording"]["name"] == "trial133.csv"
    assert session.store.attachments.content(session.state.trials[-1].details["recording"]["sha256"]) == whole


def test_a_recording_that_was_cut_on_the_way_is_not_recorded(clinic: tuple[Session, Served]) -> None:
    """The file follows the JSON of the step; how long it is, the JSON says."""
    _, served = clinic
    step = {
        "who": "ann",
        "head": served.status()["head"]["hash"],
        "trial": 133,
        "values": {"patient": 8, "therapist": 8},
        "recording": {"name": "trial133.csv", "bytes": 100},
    }
    for file in (b"", b"\n" + b"x" * 99, b"\n" + b"x\n" * 51):
        code, result = served.post("record", json.dumps(step).encode() + file)
        assert code == 422
        assert "was not sent whole" in result["error"]
    code, result = served.post("record", json.dumps(step).encode() + b"\n" + b"x\n" * 50)
    assert code == 422
    assert "trial133.csv, line 1: header is 'x'" in result["error"]
    assert served.status()["running"][0]["number"] == 133
