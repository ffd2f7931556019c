"""Shared by all tests: one BLAS thread, arrays of the shapes that are named, and the project's root."""

from __future__ import annotations

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

from pathlib import Path  # noqa: E402  (the thread limits must be set before numpy is imported)

import pytest  # noqa: E402
from shapes import check_shapes, checking  # noqa: E402

check_shapes()

ROOT = Path(__file__).resolve().parents[1]


@pytest.hookimpl(tryfirst=True)  # before the fixtures of a test are made
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Calls are checked where `shapes.CHECKED` says so."""
    checking(item.path)


@pytest.fixture(scope="session")
def project_root() -> Path:
    """Directory of the checkout under test."""
    return ROOT
