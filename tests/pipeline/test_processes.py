"""Whether the process that began a run is still there."""

from __future__ import annotations

import os

import pytest

from hdsafebo.pipeline.processes import is_alive, this_process


def test_this_process_is_alive_and_one_of_its_number_that_began_earlier_is_not() -> None:
    host, number, start = this_process().split(" ")
    assert int(number) == os.getpid()
    assert is_alive(f"{host} {number} {start}")
    assert not is_alive(f"{host} {number} {float(start) - 60:.2f}")
    assert is_alive(f"elsewhere-{host} {number} {start}"), "nobody knows from here"


@pytest.mark.parametrize("name", ["", "a b", "a b c d", "{host} x 1.0", "{host} -1 1.0", "{host} 1 nan"])
def test_what_names_no_process_is_not_alive(name: str) -> None:
    assert not is_alive(name.format(host=this_process().split(" ")[0]))
