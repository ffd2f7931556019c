"""The identity of a run covers what determines it, and its random streams do not overlap."""

from __future__ import annotations

import shutil
from pathlib import Path

import campaign_toys as toys
import numpy as np
import pytest

import hdsafebo
from hdsafebo.campaign import run_spec

real_code_digest = run_spec._code_digest


@pytest.mark.parametrize(
    ("module", "counts"),
    [
        ("kernel.py", True),
        ("optimizers/hdsafebo.py", True),
        ("problems/synthetic.py", True),
        ("campaign/runner.py", True),
        ("report/metrics.py", False),
        ("campaign/tracking.py", False),
        ("cli.py", False),
    ],
)
def test_code_that_computes_a_run_is_part_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, counts: bool
) -> None:
    package = tmp_path / "hdsafebo"
    shutil.copytree(Path(hdsafebo.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(hdsafebo, "__file__", str(package / "__init__.py"))
    before = real_code_digest.__wrapped__()
    assert before == real_code_digest.__wrapped__()
    with (package / module).open("a") as file:
        file.write("# changed\n")
    assert (real_code_digest.__wrapped__() != before) == counts


def test_streams_of_a_seed_differ_from_each_other_and_from_the_problem(tmp_path: Path) -> None:
    spec = toys.toy_spec(tmp_path, seed=3)
    streams = [np.random.default_rng(3), spec.initial_rng(), np.random.default_rng(spec.method_seed())]
    assert len({rng.integers(2**62) for rng in streams}) == 3
    other = toys.toy_spec(tmp_path, seed=4)
    assert other.method_seed() != spec.method_seed()
    assert toys.toy_spec(tmp_path, seed=3).method_seed() == spec.method_seed()
