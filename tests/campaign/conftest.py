"""The toys replace entries of registries; every test begins with the real ones."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from hdsafebo.campaign import run_spec
from hdsafebo.optimizers import registry as methods
from hdsafebo.problems import registry as tasks

_REGISTRIES: tuple[dict[str, Any], ...] = (tasks._FAMILIES, methods.METHODS)
_REAL = tuple(dict(registry) for registry in _REGISTRIES)
_REAL_DIGEST = run_spec.code_digest


@pytest.fixture(autouse=True)
def _real_registries() -> Iterator[None]:
    _restore()  # fixtures of a wider scope may have installed the toys before
    yield
    _restore()


def _restore() -> None:
    for registry, content in zip(_REGISTRIES, _REAL, strict=True):
        registry.clear()
        registry.update(content)
    run_spec.code_digest = _REAL_DIGEST
