"""Every subcommand, from `new` to `report`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from hdsafebo.errors import HdSafeBOError
from hdsafebo.session.cli import add_parser
from hdsafebo.session.errors import AuditError, ProtocolError, RecordingError
from hdsafebo.session.session import Session
from tests.session.small import bowl, write_box_files

Run = Callable[..., str]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs `hdsafebo session ...` and gives what it prints."""

    def run(*words: object) -> str:
        parser = argparse.ArgumentParser()
        add_parser(parser.add_subparsers(required=True))
        arguments = parser.parse_args(["session", *map(str, words)])
        arguments.run(arguments)
        return capsys.readouterr().out

    return run


@pytest.fixture
def directory(tmp_path: Path, run: Run) -> Path:
    """A new box session."""
    definition, initial = write_box_files(tmp_path / "files")
    text = run("new", tmp_path / "s", definition, "--initial", initial, "--who", "ann")
    assert "not a medical device" in text
    assert "8 initial trials" in text
    return tmp_path / "s"


def values(directory: Path) -> list[str]:
    """NAME=VALUE of the running trial."""
    running = Session.open(directory).state.running
    assert running is not None
    return [f"{k}={v!r}" for k, v in bowl(running.point["values"]).items()]


def test_from_new_to_report(directory: Path, run: Run, tmp_path: Path) -> None:
    assert "suggestion 1 for speed" in run("suggest", directory, "--who", "ann")
    assert "trial 9 may be delivered" in run("approve", directory, "--suggestion", 1)
    assert "trial 9 waits for its record" in run("status", directory)
    assert "trial 9 is recorded" in run("record", directory, *values(directory), "--remark", "fine")
    run("suggest", directory)
    assert "will not be made again" in run("refuse", directory, "--reason", "odd")
    run("suggest", directory)
    assert "trial 10 may be delivered" in run("modify", directory, "c=0.05", "--reason", "softer")
    run("record", directory, "--remark", "values last", *values(directory), "--who", "ann")
    run("manual", directory, "a=0.5 b=0.5 c=0", "--reason", "a check")
    assert "not delivered" in run("not-delivered", directory, "--reason", "cable")
    run("note", directory, "coffee")
    assert "stopped" in run("stop", directory, "--reason", "lunch")
    assert "STOPPED: lunch" in run("status", directory)
    run("resume", directory)
    assert "the target is economy" in run("switch-target", directory, "economy")
    assert "2 suggestions" not in run("replay", directory)
    assert "suggestions reproduced, to the bit" in run("replay", directory)

    files = run("export", directory, tmp_path / "out").split()
    table = pq.read_table(files[0])
    assert table.num_rows == 11
    assert {"a", "b", "c", "outcome_speed", "outcome_economy", "safety_margin", "safe", "origin"} <= set(
        table.column_names
    )
    assert table["origin"].to_pylist()[8:] == ["suggested", "modified", "manual"]
    head = run("verify", directory).split()[-1]
    assert head in run("verify", tmp_path / "out" / "audit.log", "--head", head)
    run("report", directory, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    for word in ("not a medical device", head, "coffee", "odd", "softer", "lunch", "Calibration", "<svg"):
        assert word in text
    assert "http://" not in text.replace("http://www.w3.org", "")


def test_bad_input_is_named(directory: Path, run: Run, tmp_path: Path) -> None:
    with pytest.raises(ProtocolError, match="no suggestion waits"):
        run("approve", directory)
    run("suggest", directory)
    run("approve", directory)
    with pytest.raises(RecordingError, match="'speed': expected NAME=VALUE"):
        run("record", directory, "speed")
    with pytest.raises(RecordingError, match="No such file"):
        run("record", directory, "--recording", tmp_path / "none.csv", "speed=1")
    with pytest.raises(HdSafeBOError, match="no session here"):
        run("status", tmp_path)
    (tmp_path / "bad.log").write_bytes(b"x")
    with pytest.raises(AuditError):
        run("verify", tmp_path / "bad.log")
    with pytest.raises(HdSafeBOError, match="cannot be read"):
        run("patient", "setup", tmp_path / "p", "--dataset", tmp_path / "none.parquet")


def test_html_of_a_report_is_escaped(directory: Path, run: Run, tmp_path: Path) -> None:
    run("note", directory, "<script>alert(1)</script>")
    run("report", directory, tmp_path / "report.html")
    assert "<script>" not in (tmp_path / "report.html").read_text()
