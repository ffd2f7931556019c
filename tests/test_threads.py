"""One thread in every library, whatever the environment says."""

from __future__ import annotations

import os
import threading

import pytest
import torch
from threadpoolctl import threadpool_info  # type: ignore[import-untyped]

from hdsafebo.threads import one_thread


def test_every_library_has_one_thread_and_gets_its_own_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with one_thread():
            assert torch.get_num_threads() == 1
            assert {library["num_threads"] for library in threadpool_info()} == {1}
            assert os.environ["OMP_NUM_THREADS"] == os.environ["MKL_NUM_THREADS"] == "1"
        assert torch.get_num_threads() == 2
        assert os.environ["OMP_NUM_THREADS"] == "3"
        assert "MKL_NUM_THREADS" not in os.environ
    finally:
        torch.set_num_threads(before)


def test_who_is_done_first_leaves_the_others_with_one_thread() -> None:
    """Such as two sessions of one process: numbers of threads are the process's."""
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    entered, counted = threading.Event(), []

    def compute() -> None:
        entered.set()
        with one_thread():
            counted.append(torch.get_num_threads())

    other = threading.Thread(target=compute)
    try:
        with one_thread():
            other.start()
            entered.wait(10.0)
            assert torch.get_num_threads() == 1
            assert not counted, "takes its turn"
        other.join(10.0)
        assert counted == [1]
    finally:
        torch.set_num_threads(before)
