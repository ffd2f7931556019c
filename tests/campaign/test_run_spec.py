"""The identity of a run covers what determines it, and its random streams do not overlap."""

from __future__ import annotations

import shutil
from pathlib import Path

import campaign_toys as toys
import numpy as np
import pytest

import hdsafebo
from hdsafebo.campaign import run_spec

real_code_digest = run_spec.code_digest


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package, to be changed."""
    copy = tmp_path_factory.mktemp("copy") / "hdsafebo"
    shutil.copytree(Path(hdsafebo.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    return copy


@pytest.mark.parametrize(
    ("module", "counts"),
    [
        ("gp/kernel.py", True),
        ("optimizers/hdsafebo.py", True),
        ("optimizers/core/persistence.py", True),  # imported within a function
        ("problems/synthetic.py", True),
        ("problems/gaussian_path.py", True),
        ("campaign/runner.py", True),
        ("campaign/run_spec.py", True),
        ("optimizers/baselines/scbo.py", False),
        ("problems/hand.py", False),
        ("report/data/metrics.py", False),
        ("pipeline/tracking.py", False),
        ("pipeline/imports.py", False),
        ("cli.py", False),
    ],
)
def test_code_that_computes_a_run_is_part_of_it(
    package: Path, monkeypatch: pytest.MonkeyPatch, module: str, counts: bool
) -> None:
    monkeypatch.setattr(hdsafebo, "__file__", str(package / "__init__.py"))
    digest = real_code_digest.__wrapped__
    before = digest("synthetic", "hdsafebo")
    assert before == digest("synthetic", "hdsafebo")
    with (package / module).open("a") as file:
        file.write("# words\n")
    assert digest("synthetic", "hdsafebo") == before
    with (package / module).open("a") as file:
        file.write("CHANGED = 1\n")
    assert (digest("synthetic", "hdsafebo") != before) == counts


def test_other_methods_and_tasks_have_other_code() -> None:
    names = [("synthetic", "hdsafebo"), ("synthetic", "scbo"), ("hand", "hdsafebo"), ("digits", "sobol")]
    assert len({real_code_digest.__wrapped__(*pair) for pair in names}) == len(names)


def test_streams_of_a_seed_differ_from_each_other_and_from_the_problem(tmp_path: Path) -> None:
    spec = toys.toy_spec(tmp_path, seed=3)
    streams = [np.random.default_rng(3), spec.initial_rng(), np.random.default_rng(spec.method_seed())]
    assert len({rng.integers(2**62) for rng in streams}) == 3
    other = toys.toy_spec(tmp_path, seed=4)
    assert other.method_seed() != spec.method_seed()
    assert toys.toy_spec(tmp_path, seed=3).method_seed() == spec.method_seed()
