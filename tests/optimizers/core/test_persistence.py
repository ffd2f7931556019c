"""A resumed optimiser is the undisturbed one, to the bit."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import StateFileError
from hdsafebo.optimizers.hdsafebo import HdSafeBO
from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
from hdsafebo.optimizers.registry import load_optimizer
from hdsafebo.trials import Status, Trials
from optimizers.toy import Halving, bowl, bowl_problem, observe_initial, rows_problem, run_rounds


def assert_same(a: Trials, b: Trials) -> None:
    for f in fields(Trials):
        np.testing.assert_array_equal(getattr(a, f.name), getattr(b, f.name), err_msg=f.name)


@pytest.mark.parametrize("method", [HdSafeBO, HdSafeBOLocal])
@pytest.mark.parametrize("when", ["before_data", "initial", "pending", "told"])
@pytest.mark.parametrize("problem", ["box", "embedded", "rows"])
@pytest.mark.thorough
def test_resumed_is_undisturbed(tmp_path: Path, method, when: str, problem: str) -> None:
    def make_problem():
        return rows_problem(300) if problem == "rows" else bowl_problem()

    embedding = Halving() if problem == "embedded" else None
    made = method(make_problem(), embedding=embedding, seed=3)

    def saved():
        made.save(tmp_path / "state")
        return method.load(tmp_path / "state", make_problem(), embedding)

    other = saved()
    if when == "before_data":
        observe_initial(other)
    observe_initial(made)
    if when == "initial":
        other = saved()
    if when in ("pending", "told"):
        run_rounds(made, 1)
        trials = made.ask(4)
        made.tell(trials[:2], *bowl(trials.x[:2]))
        if when == "pending":
            other = saved()
            other.tell([len(made.trials) - 2], [0.0], [0.0], status=Status.FAILED)
            other.tell([len(made.trials) - 1], *bowl(trials.x[3:]))
        made.tell(trials[[2]], [0.0], [0.0], status=Status.FAILED)
        made.tell(trials[3:], *bowl(trials.x[3:]))
        if when == "told":
            other = saved()
    for one in (made, other):
        run_rounds(one, 2)
    assert_same(made.trials, other.trials)
    assert made.rng.bit_generator.state == other.rng.bit_generator.state
    assert made.surrogate.state == other.surrogate.state


def test_state_between_ask_and_tell_gives_the_same_next_ask(tmp_path: Path) -> None:
    """Two rounds may be open at once; the second is asked with the fit of the first."""
    made = HdSafeBO(bowl_problem(), seed=5)
    observe_initial(made)
    run_rounds(made, 2)
    made.ask(3)
    made.save(tmp_path / "state")
    other = HdSafeBO.load(tmp_path / "state", bowl_problem())
    assert_same(made.ask(3), other.ask(3))


def test_saving_replaces_the_old_file_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "state"
    made = HdSafeBO(bowl_problem())
    observe_initial(made)
    made.save(path)
    old = path.read_bytes()

    def fail(*arguments):
        raise OSError("disk full")

    with monkeypatch.context() as patch:
        patch.setattr("hdsafebo.files.atomic.os.fsync", fail)
        with pytest.raises(StateFileError, match="cannot be written: disk full"):
            made.save(path)
    assert path.read_bytes() == old
    assert [p.name for p in tmp_path.iterdir()] == ["state"]


def test_same_state_same_bytes(tmp_path: Path) -> None:
    made = HdSafeBO(bowl_problem())
    observe_initial(made)
    made.save(tmp_path / "a")
    HdSafeBO.load(tmp_path / "a", bowl_problem()).save(tmp_path / "b")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_files_that_belong_elsewhere(tmp_path: Path) -> None:
    path = tmp_path / "state"
    made = HdSafeBO(bowl_problem(), embedding=Halving())
    observe_initial(made)
    made.save(path)
    with pytest.raises(StateFileError, match="state of method 'hdsafebo'; expected 'hdsafebo_local'"):
        HdSafeBOLocal.load(path, bowl_problem(), Halving())
    with pytest.raises(StateFileError, match="safety of the problem was"):
        HdSafeBO.load(path, bowl_problem(threshold=0.1), Halving())
    with pytest.raises(StateFileError, match="bounds of problem 'bowl' differ"):
        HdSafeBO.load(path, bowl_problem(dimension=5), Halving())
    with pytest.raises(StateFileError, match="saved with an embedding"):
        HdSafeBO.load(path, bowl_problem())

    class Other(Halving):
        def encode(self, x):
            return x / 3

    with pytest.raises(StateFileError, match="other codes"):
        HdSafeBO.load(path, bowl_problem(), Other())
    assert isinstance(load_optimizer("hdsafebo", path, bowl_problem(), Halving()), HdSafeBO)


def test_codes_that_the_encoder_does_not_give_back(tmp_path: Path) -> None:
    class Lossy(Halving):
        def encode(self, x):
            return 0.45 * x

    class Other(Lossy):
        def decode(self, z):
            return 1.9 * z

    box = [[0.0] * 4, [0.5] * 4]
    made = HdSafeBO(bowl_problem(), embedding=Lossy(), bounds=box, seed=1, empty_safe_set="mark")
    observe_initial(made, 4)
    run_rounds(made, 2)
    made.save(tmp_path / "state")
    again = HdSafeBO.load(tmp_path / "state", bowl_problem(), Lossy())
    np.testing.assert_array_equal(again.ask(2).z, made.ask(2).z)
    with pytest.raises(StateFileError, match="other codes"):
        HdSafeBO.load(tmp_path / "state", bowl_problem(), Other())


@pytest.mark.parametrize("content", [b"", b"\x00" * 64, b"\xff" * 100, b'{"a": 1}', b"\x80\x04K\x01."])
def test_damaged_files(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "state"
    path.write_bytes(content)
    with pytest.raises(StateFileError, match="state"):
        HdSafeBO.load(path, bowl_problem())


def test_missing_and_cut_files(tmp_path: Path) -> None:
    path = tmp_path / "state"
    with pytest.raises(StateFileError, match="No such file"):
        HdSafeBO.load(path, bowl_problem())
    made = HdSafeBO(bowl_problem())
    observe_initial(made)
    made.save(path)
    whole = path.read_bytes()
    for length in (7, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(StateFileError):
            HdSafeBO.load(path, bowl_problem())
