"""Which policy of the body is drawn: the best of those that were learnt safely."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def script(project_root: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("replay_body", project_root / "stages/replay_body.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("safe_enough", "shown"),
    [([True, True, True, False], 2), ([True, True, False, True], 3), ([True, False, False, False], 3)],
)
def test_the_best_policy_of_a_safe_method_is_drawn(
    script: ModuleType, safe_enough: list[bool], shown: int
) -> None:
    played = [
        {"method": method, "objective": objective}
        for method, objective in (("reflex", 9.0), ("sobol", 1.0), ("hdsafebo_local", 4.0), ("cmaes", 5.0))
    ]
    assert script._shown(played, safe_enough) == shown


def test_reflexes_alone_are_not_drawn(script: ModuleType) -> None:
    assert script._shown([{"method": "reflex", "objective": 9.0}], [True]) is None
