"""Calls of the operating system that fail, or end the process, at a chosen moment."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

_CALLS = ("pwrite", "fsync", "replace", "rename", "unlink")


class Killed(BaseException):
    """Ends a process at a certain call."""


@contextmanager
def failing(monkeypatch: pytest.MonkeyPatch, at: int, fault: BaseException) -> Iterator[list[str]]:
    """The `at`-th call that writes, syncs, renames or removes fails; half of a write gets through before."""
    calls: list[str] = []

    def wrap(name: str) -> None:
        real = getattr(os, name)

        def call(*arguments: object, **named: object) -> object:
            calls.append(name)
            if len(calls) == at:
                if name == "pwrite":
                    file, data, place = arguments
                    assert isinstance(data, bytes)
                    real(file, data[: len(data) // 2], place)
                raise fault
            return real(*arguments, **named)

        patch.setattr(os, name, call)

    with monkeypatch.context() as patch:
        for name in _CALLS:
            wrap(name)
        yield calls
