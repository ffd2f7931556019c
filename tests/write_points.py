"""Every place that writes for itself, tried on a disk that is full, limited or read-only.

`python -m tests.write_points FOLDER [FAULT ...]` prints what each write point said to each fault, as JSON.
The faults `full` and `read-only` mount small file systems below FOLDER, which needs a mount namespace.
"""

from __future__ import annotations

import json
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hdsafebo.errors import HdSafeBOError

sys.path[:0] = [str(Path(__file__).parent / "campaign")]

LARGE = "x" * 20_000  # more than the last page of a file has room for
MOUNTED_MB = 16
ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class WritePoint:
    """A place that writes.

    Attributes:
        name: of the file or folder that its message must give.
        prepare: makes what is there before; given the disk and a folder on a sound one.
        write: writes to the disk; raises a typed error when it cannot.
        intact: raises unless what was there before is still there; called when the disk is sound again.
        room: bytes that the full disk has left.
        elsewhere: needs to write on the sound disk, too, which a limit of the process forbids.
    """

    name: str
    prepare: Callable[[Path, Path], object]
    write: Callable[[Path, Path], object]
    intact: Callable[[Path, Path], object] = lambda disk, home: None
    room: int = 0
    elsewhere: bool = False


def _nothing(disk: Path, home: Path) -> None:
    pass


def _record(disk: Path, key: str) -> None:
    from hdsafebo.campaign.journal import Journal

    with Journal(disk / "rounds.log") as journal:
        journal.append(key, LARGE)


def _only_first_record(disk: Path, home: Path) -> None:
    from hdsafebo.campaign.journal import Journal

    with Journal(disk / "rounds.log") as journal:
        assert journal.records == {"round-0": LARGE}


def _with_run(disk: Path, action: Callable[[Any], object]) -> None:
    from hdsafebo.campaign.rounds import RunJournal

    with RunJournal(disk, "toy", {"seed": 1}, patience_s=0) as journal:
        action(journal)


def _round(disk: Path) -> None:
    from hdsafebo.campaign.rounds import Round

    _with_run(disk, lambda journal: journal.append(Round("0" * 64, {"trial": np.arange(9000)})))


def _save_state(disk: Path) -> None:
    _with_run(disk, lambda journal: journal.save_state(lambda path: _optimizer(path, 400)))


def _rounds(disk: Path, expected: int) -> None:
    def check(journal: Any) -> None:
        assert len(journal.rounds) == expected
        assert journal.state is None

    _with_run(disk, check)


def _problem() -> Any:
    from hdsafebo.problem import FunctionProblem

    return FunctionProblem(lambda x: (x.sum(axis=1), x[:, 0]), bounds=[[0.0] * 3, [1.0] * 3])


def _optimizer(path: Path, trials: int) -> None:
    from hdsafebo.optimizers.controls.sobol import Sobol

    made = Sobol(_problem(), seed=0)
    asked = made.ask(trials)
    made.tell(asked, asked.x.sum(axis=1), asked.x[:, 0])
    made.save(path)


def _four_trials(disk: Path, home: Path) -> None:
    from hdsafebo.optimizers.controls.sobol import Sobol

    assert len(Sobol.load(disk / "state.zip", _problem()).trials) == 4
    assert [p.name for p in disk.iterdir()] == ["state.zip"]


def _toy_spec(disk: Path) -> Any:
    import campaign_toys as toys

    return toys.toy_spec(disk)


def _toy_run(disk: Path) -> Any:
    import campaign_toys as toys

    return toys.run_toy(_toy_spec(disk))


def _toy_rounds(disk: Path, home: Path) -> None:
    """Continue, and compare with a run that had a sound disk all the time."""
    rows, expected = _toy_run(disk).rows, _toy_run(home).rows
    for name in set(expected) - {"method_seconds", "evaluate_seconds"}:
        assert rows[name].tobytes() == expected[name].tobytes()


def _run_file(disk: Path, home: Path, trials: int) -> None:
    from hdsafebo.runs.schema import TIMES
    from hdsafebo.runs.write import write_run_file

    rows = _toy_run(home).rows
    tall = {name: np.repeat(column, trials, axis=0) for name, column in rows.items()}
    noise = np.random.default_rng(0).normal(size=(len(TIMES), len(tall["seed"])))  # which does not compress
    write_run_file(disk / "runs" / "toy.parquet", [tall | dict(zip(TIMES, noise, strict=True))], _metadata())


def _metadata() -> Any:
    from hdsafebo.runs.schema import RunMetadata

    return RunMetadata(
        task="synthetic", method="toy", algorithm="toy", profile="test", settings={}, safety_names=[],
        thresholds=[], beta=None, guaranteed_alpha=None, optimum=None, n_initial=10, batch=3, n_trials=130,
        seeds=[7], space="latent", dimension=3, counts=[],
    )  # fmt: skip


def _first_run_file(disk: Path, home: Path) -> None:
    import pyarrow.parquet as pq

    assert pq.read_metadata(disk / "runs" / "toy.parquet").num_rows == 130
    assert [p.name for p in (disk / "runs").iterdir()] == ["toy.parquet"]


def _profiles(disk: Path, home: Path) -> None:
    shutil.copytree(ROOT / "profiles", disk / "profiles")
    _profile(disk, "standard")


def _profile(disk: Path, name: str) -> None:
    from hdsafebo.pipeline.profiles import apply_profile

    apply_profile(disk, name)


def _standard_params(disk: Path, home: Path) -> None:
    from hdsafebo.pipeline.checked_params import load_checked_params

    assert load_checked_params(disk / "params.yaml").profile == "standard"
    assert sorted(p.name for p in disk.iterdir()) == ["params.yaml", "profiles"]


def _session_files(disk: Path, home: Path) -> None:
    from tests.session.small import write_box_files

    write_box_files(home / "files")


def _new_session(folder: Path, home: Path) -> None:
    from hdsafebo.session.create import create_session

    definition, initial = home / "files" / "session.yaml", home / "files" / "initial.csv"
    create_session(folder / "s", definition, who="ann", initial=initial).close()


def _session(folder: Path, home: Path) -> None:
    _session_files(folder, home)
    _new_session(folder, home)


def _with_session(folder: Path, action: Callable[[Any], object]) -> None:
    from hdsafebo.session.session import Session

    session = Session.open(folder / "s")
    try:
        action(session)
    finally:
        session.close()


def _notes(disk: Path, home: Path) -> None:
    def write(session: Any) -> None:
        for _ in range(20):
            session.note("ann", LARGE[:2000])

    _with_session(disk, write)


def _sound_session(disk: Path, home: Path) -> None:
    from hdsafebo.session.views.audit import verify_session

    _with_session(disk, verify_session)


def _export(disk: Path, home: Path) -> None:
    from hdsafebo.session.views.export import export_session

    _with_session(home, lambda session: export_session(session, disk / "tables"))


def _report(disk: Path, home: Path) -> None:
    from hdsafebo.session.views.report import write_report

    _with_session(home, lambda session: write_report(session, disk / "report.html"))


POINTS = {
    "a record of a journal": WritePoint(
        "rounds.log",
        lambda disk, home: _record(disk, "round-0"),
        lambda disk, home: _record(disk, "round-1"),
        _only_first_record,
    ),
    "a new journal": WritePoint("rounds.log", _nothing, lambda disk, home: _record(disk, "round-0")),
    "a round of a run": WritePoint(
        "rounds.log",
        lambda disk, home: _round(disk),
        lambda disk, home: _round(disk),
        lambda disk, home: _rounds(disk, 1),
    ),
    "the state of a run": WritePoint(
        "toy-",
        lambda disk, home: _round(disk),
        lambda disk, home: _save_state(disk),
        lambda disk, home: _rounds(disk, 1),
    ),
    "the state of an optimiser": WritePoint(
        "state.zip",
        lambda disk, home: _optimizer(disk / "state.zip", 4),
        lambda disk, home: _optimizer(disk / "state.zip", 400),
        _four_trials,
    ),
    "a whole run": WritePoint(
        "synthetic-toy",
        lambda disk, home: _toy_spec(disk),
        lambda disk, home: _toy_run(disk),
        _toy_rounds,
        room=60_000,
    ),
    "a run file": WritePoint(
        "toy.parquet",
        lambda disk, home: _run_file(disk, home, 1),
        lambda disk, home: _run_file(disk, home, 50),
        _first_run_file,
    ),
    "a profile": WritePoint(
        "params.yaml", _profiles, lambda disk, home: _profile(disk, "smoke"), _standard_params
    ),
    "a new session": WritePoint("s", _session_files, _new_session),
    "a session's log": WritePoint("s", _session, _notes, _sound_session),
    "a session's tables": WritePoint(
        "tables", lambda disk, home: _session(home, home), _export, elsewhere=True
    ),
    "a session's report": WritePoint(
        "report.html", lambda disk, home: _session(home, home), _report, elsewhere=True
    ),
}


@contextmanager
def full(disk: Path, room: int) -> Iterator[None]:
    """Nothing but `room` bytes is left."""
    filler = disk / "filler"
    with filler.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(4096))
        except OSError:
            file.truncate(max(0, file.tell() - room))
    yield
    filler.unlink()


@contextmanager
def read_only(disk: Path, room: int) -> Iterator[None]:
    """The file system is mounted read-only."""
    subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
    yield
    subprocess.run(["mount", "-o", "remount,rw", str(disk)], check=True)


@contextmanager
def limited(disk: Path, room: int) -> Iterator[None]:
    """The system lets no file grow beyond `room` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


FAULTS = {"full": full, "read-only": read_only, "limited": limited}


def attempt(point: WritePoint, disk: Path, home: Path, fault: str) -> dict[str, str]:
    """What a write point says to a fault; then, on the sound disk, it must find all and succeed."""
    point.prepare(disk, home)
    said = {"error": "", "message": ""}
    with FAULTS[fault](disk, point.room):
        try:
            point.write(disk, home)
        except HdSafeBOError as error:
            said = {"error": type(error).__name__, "message": str(error)}
        except Exception as error:
            said = {"error": "untyped", "message": repr(error)}
    point.intact(disk, home)
    point.write(disk, home)
    return said


def main(folder: Path, faults: list[str]) -> None:
    """Try all points with the given faults."""
    found: dict[str, dict[str, dict[str, str]]] = {fault: {} for fault in faults}
    for fault in faults:
        for number, (name, point) in enumerate(POINTS.items()):
            if fault == "limited" and point.elsewhere:
                continue
            disk, home = (folder / fault / f"{kind}{number}" for kind in ("disk", "home"))
            disk.mkdir(parents=True)
            home.mkdir()
            mounted = fault != "limited"
            if mounted:
                options = ["-t", "tmpfs", "-o", f"size={MOUNTED_MB}m", "small"]
                subprocess.run(["mount", *options, str(disk)], check=True)
            found[fault][name] = attempt(point, disk, home, fault)
            if mounted:
                subprocess.run(["umount", "-l", str(disk)], check=True)
    print(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
