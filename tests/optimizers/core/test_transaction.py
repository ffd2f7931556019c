"""Calls that change an optimiser are made one at a time, and in whole or not at all."""

from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from hdsafebo.optimizers.controls.local_random import LocalRandom
from hdsafebo.optimizers.controls.sobol import Sobol
from hdsafebo.optimizers.core import transaction
from hdsafebo.optimizers.hdsafebo import HdSafeBO
from hdsafebo.trials import Status
from optimizers.toy import bowl, bowl_problem, observe_initial, run_rounds

THREADS = 8


@pytest.mark.parametrize("kind", [Sobol, LocalRandom])
def test_eight_threads_share_one_optimizer(kind, tmp_path: Path) -> None:
    made = kind(bowl_problem())
    observe_initial(made)

    def work(thread: int) -> list[int]:
        ids = []
        for number in range(20):
            trials = made.ask(2)
            made.tell(trials, *bowl(trials.x))
            made.observe(trials.x[:1], *bowl(trials.x[:1]))
            if number % 10 == 0:
                made.save(tmp_path / "state")
                kind.load(tmp_path / "state", bowl_problem())
            ids += trials.id.tolist()
        return ids

    with ThreadPoolExecutor(THREADS) as pool:
        ids = [i for part in pool.map(work, range(THREADS)) for i in part]
    assert len(set(ids)) == len(ids) == THREADS * 40
    table = made.trials
    np.testing.assert_array_equal(table.id, np.arange(12 + THREADS * 60))
    assert table.completed.all()
    np.testing.assert_array_equal(table.objective, bowl(table.x)[0])
    assert made.round == THREADS * 20


def test_threads_that_look_while_one_asks_see_one_model() -> None:
    made = HdSafeBO(bowl_problem(), candidates=200)
    other = deepcopy(made)
    for optimizer in (made, other):
        observe_initial(optimizer)
    with ThreadPoolExecutor(4) as pool:
        looks = [pool.submit(lambda: made.surrogate.length_scale) for _ in range(20)]
        run_rounds(made, 3)
        assert all(look.result() > 0 for look in looks)
    run_rounds(other, 3)
    np.testing.assert_array_equal(made.trials.x, other.trials.x)


def test_a_copy_is_on_its_own() -> None:
    made = HdSafeBO(bowl_problem(), candidates=200)
    observe_initial(made)
    copy = deepcopy(made)
    with made._lock, ThreadPoolExecutor(1) as pool:
        pool.submit(run_rounds, copy, 1).result(timeout=60)
    assert len(copy.trials) == 16
    assert len(made.trials) == 12
    np.testing.assert_array_equal(copy.trials.x[12:], made.ask(4).x)


def test_ctrl_c_pressed_again_while_a_call_goes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Sobol(bowl_problem())
    trials = made.ask(3)
    restore, presses = transaction._Snapshot.restore, iter([True, True, False])

    def impatient(snapshot, optimizer) -> None:
        if next(presses):
            raise KeyboardInterrupt
        restore(snapshot, optimizer)

    def finish(told) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(transaction._Snapshot, "restore", impatient)
    monkeypatch.setattr(made, "finish_round", finish)
    with pytest.raises(KeyboardInterrupt):
        made.tell(trials, *bowl(trials.x))
    assert (made.trials.status == Status.PENDING).all()


def test_an_observation_that_fails_leaves_no_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Sobol(bowl_problem())
    observe_initial(made)
    monkeypatch.setattr(made._fits, "forget", lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        made.observe([[0.5] * 4], [0.0], [0.0])
    assert len(made.trials) == 12
