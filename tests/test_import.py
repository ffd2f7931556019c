"""Importing the package is quick because heavy libraries load when they are used."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import hdsafebo

HEAVY = (
    "torch",
    "botorch",
    "mujoco",
    "sklearn",
    "matplotlib",
    "mlflow",
    "numba",
    "skfem",
    "stable_baselines3",
    "dvc",
    "pandas",
)


def test_importing_the_package_loads_no_heavy_library() -> None:
    code = f"import sys, hdsafebo.cli, hdsafebo.params; print([m for m in {HEAVY!r} if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_describing_a_system_waits_for_no_model() -> None:
    heavy = (*HEAVY, "scipy", "hdsafebo.gp", "hdsafebo.optimizers.base")
    code = (
        "import sys; from hdsafebo import Choice, Integer, Limit, Objective, Real, Study, System; "
        f"print([m for m in {heavy!r} if m in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_every_public_name_can_be_imported_and_is_listed() -> None:
    code = "import hdsafebo; assert set(hdsafebo.__all__) <= set(dir(hdsafebo)); from hdsafebo import *"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_errors_of_ask_tell_save_and_load_are_public() -> None:
    raised = set()
    for module in ("optimizers/base.py", "optimizers/registry.py"):
        text = (Path(hdsafebo.__file__).parent / module).read_text()
        raised |= set(re.findall(r"^ +(\w+Error): ", text, re.MULTILINE))
    assert {"TrialError", "NoSafePointError", "StateFileError"} <= raised <= set(hdsafebo.__all__)
