"""Every subcommand, from `new` to `report`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from hdsafebo.errors import HdSafeBOError
from hdsafebo.session.cli import add_parser
from hdsafebo.session.errors import AuditError, DefinitionError, LimitError, ProtocolError, RecordingError
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
    assert "not a safety system" in text
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
    recorded = run("record", directory, "--trial", 9, *values(directory), "--remark", "fine")
    assert "trial 9 is recorded" in recorded
    run("suggest", directory)
    assert "will not be made again" in run("refuse", directory, "--suggestion", 2, "--reason", "odd")
    run("suggest", directory)
    modified = run("modify", directory, "c=0.05", "--suggestion", 3, "--reason", "softer")
    assert "trial 10 may be delivered" in modified
    run("record", directory, "--trial", 10, "--remark", "values last", *values(directory), "--who", "ann")
    run("manual", directory, "a=0.5 b=0.5 c=0", "--reason", "a check")
    assert "not delivered" in run("not-delivered", directory, "--trial", 11, "--reason", "cable")
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
    for word in ("not a safety system", head, "coffee", "odd", "softer", "lunch", "Calibration", "<svg"):
        assert word in text
    assert "http://" not in text.replace("http://www.w3.org", "")


def test_bad_input_is_named(directory: Path, run: Run, tmp_path: Path) -> None:
    with pytest.raises(ProtocolError, match="no suggestion waits"):
        run("approve", directory, "--suggestion", 1)
    run("suggest", directory)
    run("approve", directory, "--suggestion", 1)
    for words, message in (
        (["speed"], "'speed': expected NAME=VALUE"),
        (["speed=1_0"], "'speed=1_0': expected NAME=VALUE"),
        (["speed=0.3", "margin=-0.4", "margin=0.4"], "margin is given twice, -0.4 before"),
        (["speed=0.3", "--recording", tmp_path / "none.csv"], "No such file"),
    ):
        with pytest.raises(RecordingError, match=message):
            run("record", directory, "--trial", 9, *words)
    assert len(Session.open(directory).entries) == 3
    with pytest.raises(HdSafeBOError, match="no session here"):
        run("status", tmp_path)
    (tmp_path / "bad.log").write_bytes(b"x")
    with pytest.raises(AuditError):
        run("verify", tmp_path / "bad.log")
    with pytest.raises(HdSafeBOError, match="cannot be read"):
        run("patient", "setup", tmp_path / "p", "--dataset", tmp_path / "none.parquet")


@pytest.mark.parametrize(
    "words",
    [
        ["approve"],
        ["refuse", "--reason", "no"],
        ["modify", "a=0.5", "--reason", "no"],
        ["record", "speed=1"],
        ["not-delivered", "--reason", "no"],
    ],
)
def test_nobody_decides_without_saying_what(directory: Path, run: Run, words: list[str]) -> None:
    """Another person may have asked for a further suggestion meanwhile, which this one never saw."""
    run("suggest", directory)
    with pytest.raises(SystemExit):
        run(words[0], directory, *words[1:])
    for number in ("1_0", "0x1", "-1", "1.0", "١"):
        with pytest.raises(SystemExit):
            run("approve", directory, "--suggestion", number)
    assert Session.open(directory).entries[-1].kind == "suggested"


def test_who_is_asked_to_approve_sees_every_input(make_session: Callable[..., Session], run: Run) -> None:
    inputs = [{"name": f"x{i}", "lower": 0.0, "upper": 1.0, "max_step": 0.3, "home": 0.5} for i in range(50)]
    from hdsafebo.session.definition import parse_definition
    from hdsafebo.session.spaces.generic import GenericSpace
    from tests.session.small import box_definition

    space = GenericSpace(parse_definition(box_definition() | {"inputs": inputs}))  # type: ignore[arg-type]
    text = space.describe({"values": [i / 100 for i in range(50)]})
    assert all(f"x{i}={i / 100:g}" in text.split() for i in range(50))
    assert space.parse(text, None) == {"values": [i / 100 for i in range(50)]}


def test_stop_needs_no_words_and_comes_before_everything_else(directory: Path, run: Run) -> None:
    run("stop", directory, "--who", "", "--reason", "x" * 3000)
    session = Session.open(directory)
    assert session.entries[-1].who == "unnamed"
    assert session.stopped == "x" * 2000
    run("resume", directory)
    for path in directory.glob("*/audit.log"):
        path.write_bytes(b"damaged")
    with pytest.raises(AuditError):
        run("stop", directory)
    assert list(directory.glob("STOP-*"))


def test_backup_repair_and_verify(directory: Path, run: Run, tmp_path: Path) -> None:
    run("note", directory, "kept")
    assert "2 entries, head" in run("backup", directory, tmp_path / "backup")
    log = tmp_path / "backup" / "original" / "audit.log"
    log.write_bytes(log.read_bytes().replace(b"kept", b"lost"))
    with pytest.raises(AuditError, match=r"original/audit.log: line 2 is damaged.*Nothing is lost"):
        run("verify", tmp_path / "backup")
    assert "restored" in run("repair", tmp_path / "backup")
    assert "intact: 3 entries" in run("verify", tmp_path / "backup")
    assert "intact: 3 entries" in run("verify", log)


def test_limits_are_tightened_and_never_widened(directory: Path, run: Run, tmp_path: Path) -> None:
    """A session file that was tightened is applied, or nothing starts; never is it ignored in silence."""
    path = tmp_path / "files" / "session.yaml"
    good = path.read_text()
    run("suggest", directory)
    path.write_text(f"# a remark\n{good}")
    run("approve", directory, "--suggestion", 1)
    run("not-delivered", directory, "--trial", 9, "--reason", "only trying")
    with pytest.raises(DefinitionError, match="no hard limit is tighter"):
        run("tighten", directory, path)
    path.write_text(good.replace("upper: 1.0", "upper: 0.55", 1))
    for words in (["suggest"], ["manual", "a=0.5 b=0.5 c=0"]):
        with pytest.raises(DefinitionError, match=r"inputs.0.upper is 0.55, in force 1.0"):
            run(words[0], directory, *words[1:])
    assert "inputs.0.upper: 1.0 -> 0.55" in run("tighten", directory, path, "--reason", "too warm")
    with pytest.raises(LimitError, match=r"a is 0.56, permitted now 0.2 to 0.55"):
        run("manual", directory, "a=0.56 b=0.5 c=0")
    text = run("suggest", directory)
    assert 0.2 <= float(text.split("a=")[1].split()[0]) <= 0.55
    for change in ("upper: 1.0", "upper: 0.55"):  # the other one, and wider again
        other = good.replace("upper: 1.0", "upper: 0.55", 1).replace(change, "upper: 0.9")
        path.write_text(other.replace("target: speed", "target: economy"))
        with pytest.raises(DefinitionError, match="target is 'economy', in force 'speed'"):
            run("tighten", directory, path)
    path.write_text(good)
    assert "suggestion 2" in run("suggest", directory)  # wider limits in the file have no effect
    assert "suggestions reproduced" in run("replay", directory)
    run("verify", directory)
    with pytest.raises(LimitError, match=r"permitted now 0.2 to 0.55"):
        run("manual", directory, "a=0.56 b=0.5 c=0")


def test_a_file_larger_than_any_recording_is_not_read(directory: Path, run: Run, tmp_path: Path) -> None:
    with (tmp_path / "large.csv").open("wb") as file:
        file.truncate(2**32)
    for path in (tmp_path / "large.csv", Path("/dev/zero")):
        with pytest.raises(RecordingError, match=r"expected at most|no regular file"):
            run("record", directory, "--trial", 9, "speed=1", "--recording", path)


def test_html_of_a_report_is_escaped(directory: Path, run: Run, tmp_path: Path) -> None:
    run("note", directory, "<script>alert(1)</script>")
    run("report", directory, tmp_path / "report.html")
    assert "<script>" not in (tmp_path / "report.html").read_text()
