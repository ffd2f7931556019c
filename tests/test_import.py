"""Importing the package is quick because heavy libraries load when they are used."""

from __future__ import annotations

import subprocess
import sys

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
