"""A study's folder: resumed to the bit, shared by processes, and whole after every kill."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from hdsafebo import Limit, Linear, Objective, Real, Study, System
from hdsafebo.errors import ParamsError, TrialError
from hdsafebo.optimizers.core.identity import fingerprint
from hdsafebo.system.errors import StudyError
from hdsafebo.system.problem import SystemProblem
from system.small import box_starts, box_system, mixed_starts, mixed_system, run_box, run_mixed

_WORKER = """
import sys
from system.small import run_box
from hdsafebo import Study
study = Study.open(sys.argv[1])
print("ready", flush=True)
for _ in range(int(sys.argv[2])):
    suggestion = study.ask()
    print("asked", suggestion.trial, flush=True)
    study.tell(suggestion, run_box(suggestion.setting))
    print("told", suggestion.trial, flush=True)
"""


def start(folder: Path, count: int, root: Path) -> subprocess.Popen[str]:
    environment = os.environ | {"PYTHONPATH": f"{root / 'src'}:{root / 'tests'}"}
    return subprocess.Popen(
        [sys.executable, "-c", _WORKER, str(folder), str(count)],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )


def begun(folder: Path) -> Study:
    study = Study.open(folder, box_system(), alpha=0.95, seed=1)
    study.observe(box_starts())
    return study


def test_goes_on_as_if_nothing_had_happened(tmp_path: Path) -> None:
    apart, together = (Study.open(tmp_path / n, mixed_system(), alpha=0.95) for n in ("apart", "together"))
    for study in (apart, together):
        study.observe(mixed_starts())
    for number in range(6):
        apart = Study.open(tmp_path / "apart")
        for study in (apart, together):
            suggestion = study.ask(context={"load": 1.0})
            if number == 3:
                study.tell(suggestion, failed=True)
            else:
                study.tell(suggestion, run_mixed(suggestion.setting, suggestion.context))
    pd.testing.assert_frame_equal(apart.to_dataframe(), together.to_dataframe())
    memory = Study(mixed_system(), alpha=0.95)
    memory.observe(mixed_starts())
    first = memory.ask(context={"load": 1.0})
    assert first.setting == {k: v for k, v in apart.to_dataframe().loc[20].items() if k in first.setting}


def test_two_handles_take_turns(tmp_path: Path) -> None:
    one = begun(tmp_path / "s")
    other = Study.open(tmp_path / "s")
    first, second = one.ask(), other.ask()
    assert (first.trial, second.trial) == (8, 9)
    other.tell(first.trial, run_box(first.setting))
    one.tell(second.trial, run_box(second.setting))
    pd.testing.assert_frame_equal(one.to_dataframe(), other.to_dataframe())


def test_processes_share_a_study(tmp_path: Path, project_root: Path) -> None:
    begun(tmp_path / "s")
    workers = [start(tmp_path / "s", 4, project_root) for _ in range(3)]
    told = [
        line.split()[1]
        for worker in workers
        for line in worker.communicate(timeout=300)[0].splitlines()
        if "told" in line
    ]
    assert all(worker.returncode == 0 for worker in workers)
    table = Study.open(tmp_path / "s").to_dataframe()
    assert sorted(map(int, told)) == list(range(8, 20))
    assert (table["status"] == "completed").all()
    assert len(table[["a", "b"]].drop_duplicates()) == len(table)


def test_nothing_acknowledged_is_lost_when_a_process_is_killed(tmp_path: Path, project_root: Path) -> None:
    begun(tmp_path / "s")
    acknowledged: set[int] = set()
    for attempt in range(4):
        worker = start(tmp_path / "s", 1000, project_root)
        assert worker.stdout is not None
        lines = [worker.stdout.readline().strip() for _ in range(2 + attempt)]  # ready, asked, told, ...
        time.sleep(0.003 * attempt**2)
        worker.send_signal(signal.SIGKILL)
        lines += worker.communicate()[0].splitlines()
        acknowledged |= {int(line.split()[1]) for line in lines if line.startswith("told ")}
        table = Study.open(tmp_path / "s").to_dataframe()
        assert set(table.index[table["status"] == "completed"]) >= acknowledged
    assert acknowledged


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"method": "linebo"}, "method of the study is 'hdsafebo_local'; expected 'linebo'"),
        ({"seed": 2}, "seed of the study is 1; expected 2"),
        ({"alpha": 0.9}, "alpha of the study is 0.95; expected 0.9"),
        ({"system": box_system(limits=[Limit("load", at_most=13)])}, "limits of the study's system"),
        ({"system": box_system(name="other")}, "name of the study's system is 'box'; expected 'other'"),
    ],
)
def test_another_study_is_refused(tmp_path: Path, arguments: dict, message: str) -> None:
    begun(tmp_path / "s")
    with pytest.raises(StudyError, match=message):
        Study.open(tmp_path / "s", **arguments)


def test_folders_that_are_no_study(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="no study is there; pass the system"):
        Study.open(tmp_path / "nothing")
    (tmp_path / "file").write_text("x")
    with pytest.raises(StudyError, match="is a file"):
        Study.open(tmp_path / "file", box_system())
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("x")
    with pytest.raises(StudyError, match="a folder with other files"):
        Study.open(tmp_path / "full", box_system())
    with pytest.raises(ParamsError):
        Study.open(tmp_path / "new", box_system(), no_such_setting=1)
    assert not (tmp_path / "new").exists(), "what cannot be begun leaves no folder"


@pytest.mark.parametrize("name", ["system.json", "state"])
def test_damage_is_named_and_nothing_is_overwritten(tmp_path: Path, name: str) -> None:
    begun(tmp_path / "s")
    path = tmp_path / "s" / name
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x41
    path.write_bytes(content if name == "state" else content[: len(content) // 2])
    damaged = path.read_bytes()
    with pytest.raises(StudyError, match=f"s/{name}|{name}"):
        Study.open(tmp_path / "s").ask()
    assert path.read_bytes() == damaged


def test_every_changed_byte_of_a_description_is_noticed(tmp_path: Path) -> None:
    """Also before anything was told: a digit of a range or of alpha must not be read as another one."""
    Study.open(tmp_path / "s", box_system(), alpha=0.95, seed=1)
    path = tmp_path / "s" / "system.json"
    content = path.read_bytes()
    for place in range(len(content)):
        changed = bytearray(content)
        changed[place] ^= 1
        path.write_bytes(changed)
        try:
            study = Study.open(tmp_path / "s")
        except StudyError:
            continue
        assert changed[place] in b" \n\t!\x0b" or study.system == box_system(), f"byte {place} is another one"
        assert (study.seed, study.settings) == (1, {"alpha": 0.95})


@pytest.mark.parametrize(
    "change",
    [
        {"parameters": [Real("a", 0, 100), Real("b", 0, 10)]},
        {"parameters": [Real("b", 0, 10), Real("a", 0, 10)]},
        {"parameters": [Real("a", 0, 10, unit="mA"), Real("b", 0, 10)]},
        {"parameters": [Real("a", 0, 10, step=0.5), Real("b", 0, 10)]},
        {"objective": Objective("gain", "minimise")},
        {"limits": [Limit("load", at_most=12, noise=0.5)]},
        {"constraints": ["a + b <= 11"]},
        {"failures": "ignored"},
    ],
)
def test_the_state_of_another_system_is_refused(tmp_path: Path, change: dict) -> None:
    """The optimiser sees the same box, whatever its sides are called and how long they are."""
    begun(tmp_path / "s")
    Study.open(tmp_path / "other", box_system(**change), alpha=0.95, seed=1)
    shutil.copy(tmp_path / "s" / "state", tmp_path / "other" / "state")
    with pytest.raises(StudyError, match="other/state: description of the problem was"):
        Study.open(tmp_path / "other")


def test_the_state_of_another_alpha_is_refused(tmp_path: Path) -> None:
    begun(tmp_path / "s")
    Study.open(tmp_path / "other", box_system(), alpha=0.99, seed=1)
    shutil.copy(tmp_path / "s" / "state", tmp_path / "other" / "state")
    with pytest.raises(StudyError, match=r"other/state: is of a study .* other settings"):
        Study.open(tmp_path / "other")


@pytest.mark.parametrize("still_open", [True, False])
def test_a_study_that_lost_its_state_does_not_begin_anew(tmp_path: Path, still_open: bool) -> None:
    study = begun(tmp_path / "s")
    (tmp_path / "s" / "state").unlink()
    with pytest.raises(StudyError, match="s/state: is missing, and with it all that the study was told"):
        study.observe(box_starts()) if still_open else Study.open(tmp_path / "s")


@pytest.mark.parametrize("state", ["told", "of another system", "no state at all"])
def test_a_study_that_lost_its_description_does_not_begin_anew(tmp_path: Path, state: str) -> None:
    folder = tmp_path / "s"
    if state == "told":
        begun(folder)
    else:
        Study.open(folder, box_system(limits=[Limit("load", at_most=9)]), alpha=0.95, seed=1)
    (folder / "system.json").unlink()
    if state == "no state at all":
        (folder / "state").write_bytes(b"somebody's notes")
    kept = (folder / "state").read_bytes()
    with pytest.raises(StudyError, match=r"system\.json: is missing, and the state beside it"):
        Study.open(folder, box_system(), alpha=0.95, seed=1)
    assert (folder / "state").read_bytes() == kept


_KILLED_AT_A_FILE = """
import os, sys
from pathlib import Path
from system.small import box_starts, box_system
from hdsafebo import Study
replace, left = Path.replace, int(sys.argv[2])
def killed(*arguments):
    global left
    left -= 1
    return os._exit(9) if left < 0 else replace(*arguments)
Path.replace = killed
study = Study.open(sys.argv[1], box_system(), alpha=0.95, seed=1)
study.observe(box_starts())
"""


@pytest.mark.parametrize("files", [0, 1, 2])
def test_killed_at_any_file_a_study_goes_on_and_nothing_is_left(
    tmp_path: Path, project_root: Path, files: int
) -> None:
    folder = tmp_path / "s"
    environment = os.environ | {"PYTHONPATH": f"{project_root / 'src'}:{project_root / 'tests'}"}
    command = [sys.executable, "-c", _KILLED_AT_A_FILE, str(folder), str(files)]
    assert subprocess.run(command, env=environment, check=False).returncode == 9
    assert any(p.name.startswith(".") for p in folder.iterdir()), "the process was killed before it wrote"
    assert len(begun(folder)) == 8
    assert {p.name for p in folder.iterdir()} == {"lock", "state", "system.json"}


def test_a_beginning_that_was_cut_short_is_begun_again(tmp_path: Path) -> None:
    Study.open(tmp_path / "s", box_system(), alpha=0.95, seed=1)
    (tmp_path / "s" / "system.json").unlink()  # it is written last
    assert len(begun(tmp_path / "s")) == 8


def test_a_study_of_the_former_format_goes_on(tmp_path: Path) -> None:
    """Its description has no digest, and nothing was saved before the first step."""
    Study.open(tmp_path / "s", box_system(), alpha=0.95, seed=1)
    path = tmp_path / "s" / "system.json"
    data = json.loads(path.read_text()) | {"format": 1}
    del data["digest"]
    path.write_text(json.dumps(data))
    (tmp_path / "s" / "state").unlink()
    study = Study.open(tmp_path / "s")
    study.observe(box_starts())
    assert len(Study.open(tmp_path / "s")) == 8
    (tmp_path / "s" / "state").unlink()
    with pytest.raises(StudyError, match="is missing"):
        study.ask()


@pytest.mark.parametrize("number", [np.float32, np.float16, np.int64, np.uint8, Fraction])
def test_numbers_of_every_kind_can_be_kept(tmp_path: Path, number: Callable[[int], Any]) -> None:
    """A range is often the smallest and largest value of an array."""
    system = box_system(
        parameters=[Real("a", number(0), number(10), step=number(1)), Real("b", 0, 10)],
        objective=Objective("gain", noise=number(1)),
        limits=[Limit("load", at_most=number(12), noise=number(1))],
        constraints=[Linear({"a": number(1), "b": number(2)}, at_most=number(30))],
    )
    settings = {"beta": np.float32(-2)} if number is np.float32 else {"alpha": np.float64(0.95)}
    study = Study.open(tmp_path / "s", system, seed=np.int64(1), **settings)
    study.observe(box_starts())
    assert len(Study.open(tmp_path / "s", system)) == 8
    with pytest.raises(StudyError, match="seed of the study is 1; expected 2"):
        Study.open(tmp_path / "s", seed=2)


@pytest.mark.parametrize("seed", [1.5, True, -1, "3", None])
def test_a_seed_is_a_whole_number(tmp_path: Path, seed: Any) -> None:
    with pytest.raises(ParamsError, match="expected a whole number, at least 0"):
        Study(box_system(), seed=seed)
    if seed is not None:
        with pytest.raises(ParamsError, match="expected a whole number, at least 0"):
            Study.open(tmp_path / "s", box_system(), seed=seed)
    assert not (tmp_path / "s").exists()


def test_csv(tmp_path: Path) -> None:
    study = begun(tmp_path / "s")
    study.to_csv(tmp_path / "trials.csv")
    read = pd.read_csv(tmp_path / "trials.csv", index_col="trial")
    pd.testing.assert_frame_equal(read, study.to_dataframe(), check_dtype=False)
    other = Study(box_system())
    other.observe(read[["a", "b", "gain", "load"]])
    assert len(other) == len(study)


def list_with_load(speeds: list[float]) -> System:
    """A list of speeds under a load that is known before each trial."""
    return System(
        name="list",
        parameters=[Real("speed", 0.1, 1.5)],
        objective=Objective("way"),
        limits=[Limit("sway", at_most=25)],
        contexts=[Real("load", 0, 5)],
        settings={"speed": speeds},
    )


def test_what_tells_a_list_from_others_does_not_depend_on_the_context_of_the_day() -> None:
    """A saved list was taken for another one as soon as a context was held."""
    problem = SystemProblem(list_with_load([0.1, 0.2, 0.3]))
    assert problem.candidates is not None
    before = fingerprint(problem.candidates)
    problem.candidates.hold(np.array([0.8]))
    np.testing.assert_array_equal(fingerprint(problem.candidates), before)


def test_the_study_of_a_list_goes_on_under_every_context(tmp_path: Path) -> None:
    """Each trial was checked against its row under the context of the day, so none of them fitted."""
    speeds = np.linspace(0.1, 1.5, 30).round(3).tolist()
    study = Study.open(tmp_path / "s", list_with_load(speeds), alpha=0.9)
    study.observe(
        [{"speed": v, "load": 1.0 + i % 2, "way": v, "sway": 1 + v} for i, v in enumerate(speeds[:16])]
    )
    for load in (1.0, 2.0, 1.5):
        again = Study.open(tmp_path / "s")
        suggestion = again.ask(context={"load": load})
        assert suggestion.context == {"load": load}
        study.tell(suggestion, {"way": suggestion.setting["speed"], "sway": 2.0})
    assert len(Study.open(tmp_path / "s")) == 19
    with pytest.raises(TrialError):
        study.tell(99, {"way": 1.0, "sway": 2.0})
    assert len(study) == 19, "a step that fails reads the state again"


def test_a_setting_given_as_it_is_opens_the_study(tmp_path: Path) -> None:
    """Its default, given when the study is opened again, was refused as another setting than None."""
    Study.open(tmp_path / "plain", box_system())
    study = Study.open(tmp_path / "plain", box_system(), empty_safe_set="abstain", max_fitted_trials=None)
    assert study.settings == {}
    for given in ({"empty_safe_set": "mark"}, {"alpha": 0.95}, {"nothing": 1}):
        (key,) = given
        with pytest.raises(StudyError, match=f"{key} of the study is"):
            Study.open(tmp_path / "plain", **given)
    Study.open(tmp_path / "promised", box_system(), alpha=0.95)
    assert Study.open(tmp_path / "promised", alpha=0.95).settings == {"alpha": 0.95}
    with pytest.raises(StudyError, match=r"beta of the study is .*; expected 2"):
        Study.open(tmp_path / "promised", beta=2.0)


@pytest.mark.parametrize("with_lock", [True, False])
def test_a_study_that_cannot_be_written_is_looked_at_in_every_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, with_lock: bool
) -> None:
    """An archive, a snapshot, a colleague's folder."""
    path = tmp_path / "s"
    study = begun(path)
    known = study.to_dataframe()
    if not with_lock:
        (path / "lock").unlink()
    really = os.open

    def read_only(name: Any, flags: int, *args: Any, **kwargs: Any) -> int:
        if str(name).startswith(str(path)) and flags & (os.O_RDWR | os.O_WRONLY | os.O_CREAT):
            raise OSError(errno.EROFS, "Read-only file system", str(name))
        return really(name, flags, *args, **kwargs)

    monkeypatch.setattr(os, "open", read_only)
    archived = Study.open(path)
    assert archived.to_dataframe().equals(known)
    assert archived.best() == study.best()
    assert len(archived.predict(archived.to_dataframe()[list(archived.system.inputs)])) == len(known)
    assert archived.expected_gain() >= 0
    for step in (lambda: archived.observe(box_starts()), archived.ask):
        with pytest.raises(StudyError, match="cannot be locked"):
            step()
