"""A run that was killed anywhere ends as if nothing had happened; what is damaged is never continued."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import campaign_toys as toys
import numpy as np
import pytest

from hdsafebo.campaign.errors import CampaignError
from hdsafebo.campaign.journal import Journal
from hdsafebo.campaign.rounds import Round, RunJournal
from hdsafebo.campaign.run_spec import RunSpec
from hdsafebo.campaign.runner import RunResult, run
from hdsafebo.errors import JournalError, ParamsError, StateFileError
from hdsafebo.files.atomic import WriteError
from hdsafebo.runs.schema import TIMES, Rows

Patch = pytest.MonkeyPatch


def assert_same(one: Rows, two: Rows, *, times: bool = False) -> None:
    """Equal to the bit, but for the times."""
    assert list(one) == list(two)
    for name in one:
        if times or name not in TIMES:
            assert one[name].dtype.kind == two[name].dtype.kind
            assert one[name].tobytes() == two[name].tobytes(), name


def run_directory(spec: RunSpec) -> Path:
    (directory,) = spec.journal.glob(f"{spec.name}-*")
    return directory


def acknowledged(spec: RunSpec) -> int:
    """Trials that the run said it had made durable."""
    try:
        return int((Path(spec.progress) / str(spec.seed)).read_text() or 0)
    except FileNotFoundError:
        return 0


def journalled(spec: RunSpec) -> list[int]:
    """Trials in the journal, by their number."""
    with Journal(run_directory(spec) / "rounds.log") as log:
        rounds = [record for key, record in log.records.items() if key.startswith("round-")]
    columns = [column for record in rounds for column in record["rows"] if column["name"] == "trial"]  # type: ignore[index,call-overload]
    return [trial for column in columns for trial in column["values"]]


def compute_with_kills(spec: RunSpec, kills: int, rng: np.random.Generator, longest_s: float) -> RunResult:
    """Kill the run's process at random moments; meanwhile nothing acknowledged may be lost or repeated."""
    context = multiprocessing.get_context("forkserver")
    # The server of 3.11 imports the module only from where its environment points.
    folders = [str(Path(toys.__file__).parent), os.environ.get("PYTHONPATH", "")]
    os.environ["PYTHONPATH"] = os.pathsep.join(folders)
    context.set_forkserver_preload(["campaign_toys"])
    died = 0
    while died < kills:
        process = context.Process(target=toys.run_toy, args=(spec,))
        before = acknowledged(spec)
        process.start()
        # Count from the first sign of life, so that kills hit the run and not the start of its process.
        while acknowledged(spec) in (0, before) and process.is_alive():
            time.sleep(0.001)
        time.sleep(rng.uniform(0, longest_s))
        process.kill()
        process.join()
        died += process.exitcode == -signal.SIGKILL
        trials = journalled(spec)
        assert trials == list(range(len(trials)))
        assert len(trials) >= acknowledged(spec)
        if process.exitcode == 0:
            break
    assert died >= min(kills, 3)
    return toys.run_toy(spec)


def test_ten_kills_change_nothing(tmp_path: Path) -> None:
    undisturbed = toys.run_toy(toys.toy_spec(tmp_path / "a", trials=400))
    spec = toys.toy_spec(tmp_path / "b", trials=400)
    disturbed = compute_with_kills(spec, 10, np.random.default_rng(3), longest_s=0.06)
    assert_same(disturbed.rows, undisturbed.rows)
    assert disturbed.facts == undisturbed.facts


@pytest.mark.slow
def test_a_hundred_kills_change_nothing(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    undisturbed = toys.run_toy(toys.toy_spec(tmp_path / "a", trials=1500))
    for attempt in range(5):
        spec = toys.toy_spec(tmp_path / str(attempt), trials=1500)
        assert_same(compute_with_kills(spec, 20, rng, longest_s=0.15).rows, undisturbed.rows)


class Cut(Exception):
    """Stands for whatever ends a process."""


def cut(monkeypatch: Patch, spec: RunSpec, where: str, calls: int) -> None:
    """Run until the given function was called so many times."""
    counter = iter(range(calls))
    with monkeypatch.context() as patch:
        for owner, name in ((toys.Memory, "evaluate"), (toys.Toy, "propose"), (Journal, "append")):
            if name != where:
                continue
            real = getattr(owner, name)

            def limited(*arguments, real=real):  # type: ignore[no-untyped-def]
                if next(counter, None) is None:
                    raise Cut
                return real(*arguments)

            patch.setattr(owner, name, limited)
        with pytest.raises(Cut):
            toys.run_toy(spec)


@pytest.mark.parametrize("where", ["evaluate", "propose", "append"])
@pytest.mark.parametrize("never_save", [False, True])
def test_a_run_that_is_cut_in_any_step_continues(
    tmp_path: Path, monkeypatch: Patch, where: str, never_save: bool
) -> None:
    undisturbed = toys.run_toy(toys.toy_spec(tmp_path / "a", trials=70))
    for calls in (0, 1, 8, 18):
        spec = toys.toy_spec(tmp_path / f"b{calls}", trials=70)
        with monkeypatch.context() as patch:
            if never_save:
                patch.setattr("hdsafebo.campaign.runner._Run._save_state_sometimes", lambda self: None)
            else:
                patch.setattr("hdsafebo.campaign.runner._STATE_SHARE", float("inf"))
            cut(patch, spec, where, calls)
            states = list(run_directory(spec).glob("state-*"))
            assert len(states) <= (0 if never_save else 2)
            cut_rounds = (run_directory(spec) / "rounds.log").read_bytes()
            assert_same(toys.run_toy(spec).rows, undisturbed.rows)
            kept = (run_directory(spec) / "rounds.log").read_bytes()
            assert kept.startswith(cut_rounds), "finished rounds are kept with their times"


def test_a_finished_run_is_read_and_not_computed(tmp_path: Path, monkeypatch: Patch) -> None:
    spec = toys.toy_spec(tmp_path)
    first = toys.run_toy(spec)
    monkeypatch.setattr(toys.Memory, "evaluate", lambda self, trials: 1 / 0)
    second = toys.run_toy(spec)
    assert_same(first.rows, second.rows, times=True)
    assert first.facts == second.facts
    assert sorted(p.name for p in run_directory(spec).iterdir()) == ["lock", "rounds.log"]


def test_rows_keep_every_column_of_the_trials(tmp_path: Path) -> None:
    rows = toys.run_toy(toys.toy_spec(tmp_path)).rows
    assert rows["initial"].sum() == 10
    assert rows["round"].tolist() == [0] * 10 + [1 + i // 3 for i in range(120)]
    failed = rows["status"] == "failed"
    assert 0 < failed.sum() < 60
    assert np.isnan(rows["objective"][failed]).all()
    assert not rows["safe"][failed].any()
    done = ~failed
    expected = np.maximum(0, -1.5 - rows["safety"]) + np.maximum(0, -0.9 - rows["safety_second"])
    np.testing.assert_array_equal(rows["violation"][done], expected[done])
    np.testing.assert_array_equal(rows["safe"][done], expected[done] == 0)
    assert (rows["safety_hidden"][done] == 0).all()
    assert (np.diff(rows["trust_region_length"][10::3]) < 0).all()


def test_initial_trials_depend_on_the_seed_only(tmp_path: Path) -> None:
    one = toys.run_toy(toys.toy_spec(tmp_path / "a")).rows
    other_settings = toys.run_toy(toys.toy_spec(tmp_path / "b", abstain_after=500, batch=5)).rows
    other_seed = toys.run_toy(toys.toy_spec(tmp_path / "c", seed=8)).rows
    assert (one["z"][:10] == other_settings["z"][:10]).all()
    assert (one["z"][:10] != other_seed["z"][:10]).all()


def test_a_method_may_ask_for_its_first_trials_itself(tmp_path: Path) -> None:
    rows = toys.run_toy(toys.toy_spec(tmp_path, method="lonely")).rows
    assert len(rows["trial"]) == 130
    assert rows["initial"].sum() == 10
    assert rows["round"].tolist() == [0] * 10 + [1 + i // 3 for i in range(120)]
    given = toys.run_toy(toys.toy_spec(tmp_path)).rows
    assert (rows["z"][:10] != given["z"][:10]).all()


def test_a_method_that_abstains_ends_the_run_with_its_reason(tmp_path: Path) -> None:
    spec = toys.toy_spec(tmp_path, abstain_after=40)
    result = toys.run_toy(spec)
    assert result.abstained == "the toy has seen enough"
    assert len(result.rows["trial"]) == 40
    assert toys.run_toy(spec).abstained == result.abstained


def test_whatever_determines_a_run_gives_it_a_journal_of_its_own(tmp_path: Path) -> None:
    for changes in (
        {},
        {"trials": 131},
        {"batch": 4},
        {"initial": 11},
        {"seconds": 2e-9},
        {"abstain_after": 500},
        {"seed": 8},
    ):
        toys.run_toy(toys.toy_spec(tmp_path, **changes))  # type: ignore[arg-type]
    (tmp_path / "data" / "input.txt").write_text("another content")
    toys.run_toy(toys.toy_spec(tmp_path))
    assert len(list((tmp_path / ".journal").iterdir())) == 8
    indifferent = toys.toy_spec(tmp_path)
    params = dict(indifferent.params) | {"profile": "other", "compute": {"workers": 7}}
    toys.run_toy(replace(indifferent, params=params))
    assert len(list((tmp_path / ".journal").iterdir())) == 8


def test_a_missing_input_is_named(tmp_path: Path) -> None:
    spec = toys.toy_spec(tmp_path)
    (tmp_path / "data" / "input.txt").unlink()
    with pytest.raises(ParamsError, match=r"input\.txt, which is missing: run the stage that writes it"):
        toys.run_toy(spec)


def half_done(tmp_path: Path, monkeypatch: Patch) -> RunSpec:
    spec = toys.toy_spec(tmp_path)
    monkeypatch.setattr("hdsafebo.campaign.runner._STATE_SHARE", float("inf"))
    cut(monkeypatch, spec, "evaluate", 20)
    return spec


def test_a_damaged_journal_is_an_error_and_stays_as_it_is(tmp_path: Path, monkeypatch: Patch) -> None:
    spec = half_done(tmp_path, monkeypatch)
    log = run_directory(spec) / "rounds.log"
    content = bytearray(log.read_bytes())
    content[len(content) // 2] ^= 1
    log.write_bytes(content)
    with pytest.raises(JournalError, match=r"damaged after .* good records"):
        toys.run_toy(spec)
    assert log.read_bytes() == content


@pytest.mark.parametrize("damage", ["flip", "truncate", "remove"])
def test_a_damaged_state_is_an_error(tmp_path: Path, monkeypatch: Patch, damage: str) -> None:
    spec = half_done(tmp_path, monkeypatch)
    (state,) = run_directory(spec).glob("state-*")
    content = bytearray(state.read_bytes())
    content[len(content) // 2] ^= 1
    {
        "flip": lambda: state.write_bytes(content),
        "truncate": lambda: state.write_bytes(content[:-1]),
        "remove": state.unlink,
    }[damage]()
    with pytest.raises(JournalError, match=r"state-\d+: is (damaged|missing); remove .* to compute"):
        toys.run_toy(spec)


def test_a_state_that_is_no_file_is_an_error(tmp_path: Path, monkeypatch: Patch) -> None:
    spec = half_done(tmp_path, monkeypatch)
    (state,) = run_directory(spec).glob("state-*")
    state.unlink()
    os.mkfifo(state)
    with pytest.raises(JournalError, match=r"state-\d+: is no regular file; remove .* to compute"):
        toys.run_toy(spec)


def test_a_run_whose_lock_was_deleted_ends(tmp_path: Path) -> None:
    """Another process may hold a new lock by now, and compute the same run."""
    entry = Round("points", {"seed": np.zeros(1, np.int32)})
    with RunJournal(tmp_path, "run", {}) as one:
        (one.directory / "lock").unlink()
        with RunJournal(tmp_path, "run", {}, patience_s=0.0) as two:
            two.append(entry)
            with pytest.raises(JournalError, match="lock: was deleted while the run is computed"):
                one.append(entry)
    with RunJournal(tmp_path, "run", {}) as again:
        assert len(again.rounds) == 1


def test_an_evaluation_that_is_not_reproduced_is_an_error(tmp_path: Path, monkeypatch: Patch) -> None:
    spec = half_done(tmp_path, monkeypatch)
    real = toys.Memory.evaluate

    def last_bit(self, trials):  # type: ignore[no-untyped-def]
        result = real(self, trials)
        return replace(result, objective=np.nextafter(result.objective, 9))

    monkeypatch.setattr(toys.Memory, "evaluate", last_bit)
    with pytest.raises(JournalError, match="the evaluation gave other values than the journal"):
        toys.run_toy(spec)


def test_a_proposal_that_is_not_reproduced_is_an_error(tmp_path: Path, monkeypatch: Patch) -> None:
    spec = toys.toy_spec(tmp_path)
    monkeypatch.setattr("hdsafebo.campaign.runner._Run._save_state_sometimes", lambda self: None)
    cut(monkeypatch, spec, "evaluate", 20)
    monkeypatch.setattr(toys.Toy, "step", np.nextafter(1.0, 2))
    with pytest.raises(JournalError, match="other points were proposed than the journal holds for trials 1"):
        toys.run_toy(spec)


def test_a_problem_without_a_memory_is_not_evaluated_again(tmp_path: Path, monkeypatch: Patch) -> None:
    monkeypatch.setattr(toys.Memory, "depends_on_history", False, raising=False)
    spec = half_done(tmp_path, monkeypatch)
    calls: list[int] = []
    real = toys.Memory.evaluate
    monkeypatch.setattr(
        toys.Memory, "evaluate", lambda self, t: (calls.append(int(t.id[0])), real(self, t))[1]
    )
    toys.run_toy(spec)
    assert min(calls) == 10 + 19 * 3


def test_two_processes_cannot_compute_the_same_run(tmp_path: Path, monkeypatch: Patch) -> None:
    from hdsafebo.campaign.rounds import RunJournal

    with (
        RunJournal(tmp_path, "run", {"a": 1}),
        pytest.raises(JournalError, match="another process has computed this run for over 0 s"),
    ):
        RunJournal(tmp_path, "run", {"a": 1}, patience_s=0.3)
    with RunJournal(tmp_path, "run", {"a": 1}, patience_s=0.3), RunJournal(tmp_path, "run", {"a": 2}):
        pass


def test_a_full_disk_stops_the_run_and_it_continues_later(tmp_path: Path, monkeypatch: Patch) -> None:
    undisturbed = toys.run_toy(toys.toy_spec(tmp_path / "a"))
    spec = toys.toy_spec(tmp_path / "b")
    counter = iter(range(9))
    real = os.pwrite

    def full(*arguments):  # type: ignore[no-untyped-def]
        if next(counter, None) is None:
            raise OSError(28, "No space left on device")
        return real(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", full)
        with pytest.raises(JournalError, match="No space left on device"):
            toys.run_toy(spec)
    assert_same(toys.run_toy(spec).rows, undisturbed.rows)


def test_a_state_that_cannot_be_written_stops_the_run_and_it_continues_later(
    tmp_path: Path, monkeypatch: Patch
) -> None:
    undisturbed = toys.run_toy(toys.toy_spec(tmp_path / "a"))
    spec = toys.toy_spec(tmp_path / "b")

    def full(path: Path) -> NoReturn:
        raise WriteError(f"{path}: cannot be written: No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("hdsafebo.optimizers.core.state_file.replacing", full)
        with pytest.raises(StateFileError, match="No space left on device"):
            toys.run_toy(spec)
    assert_same(toys.run_toy(spec).rows, undisturbed.rows)


def test_a_stopped_campaign_ends_the_run_after_its_round(tmp_path: Path) -> None:
    spec = toys.toy_spec(tmp_path)
    (tmp_path / "progress" / "stop").touch()
    with pytest.raises(CampaignError, match="stopped as another one failed"):
        run(spec)
    (tmp_path / "progress" / "stop").unlink()
    assert journalled(spec) == list(range(10))
    assert len(toys.run_toy(spec).rows["trial"]) == 130
