"""Whether a line of a shell block could run: its program, target, subcommand, options and files are there."""

from __future__ import annotations

import argparse
import re
import shlex
import tomllib
from collections.abc import Callable
from pathlib import Path

from hdsafebo.cli import _parser

Check = Callable[[list[str], Path], None]


class Refused(Exception):
    """The line could not run; the message says why."""


def check(line: str, root: Path) -> None:
    """Raise `Refused` where a line names something that is not there."""
    words = shlex.split(line, comments=True)
    while words and re.fullmatch(r"[A-Z_]+=.*", words[0]):
        words = words[1:]
    if not words:
        return
    program = words[0].removeprefix(".venv/bin/")
    if program not in _CHECKS:
        raise Refused(f"{program!r} is no program that the documentation may use: {sorted(_CHECKS)}")
    _CHECKS[program](words[1:], root)


def _make(words: list[str], root: Path) -> None:
    text = (root / "Makefile").read_text(encoding="utf-8")
    for word in words:
        name, _, value = word.partition("=")
        if value:
            _need(f"{name} ?=" in text or f"$({name})" in text, f"no variable {name} in the Makefile")
        else:
            _need(re.search(rf"(?m)^{name}:", text) is not None, f"no target {name}")
        if name == "PROFILE":
            _need((root / "profiles" / f"{value}.yaml").exists(), f"no profile {value}")


def _hdsafebo(words: list[str], root: Path) -> None:
    _parses(_parser(), words)


def _dvc(words: list[str], root: Path) -> None:
    from dvc.cli.parser import get_main_parser

    _parses(get_main_parser(), words)


def _parses(parser: argparse.ArgumentParser, words: list[str]) -> None:
    try:
        parser.parse_args(words)
    except SystemExit as stopped:
        raise Refused(f"{parser.prog} does not take {shlex.join(words)}") from stopped
    except Exception as error:  # DVC raises its own
        raise Refused(f"{parser.prog} does not take {shlex.join(words)}: {error}") from error


def _pip(words: list[str], root: Path) -> None:
    extras = tomllib.loads((root / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    _need(words[0] == "install", "pip installs")
    for word in words[1:]:
        own = re.fullmatch(r"(?:hdsafebo|\.)\[(.*)\]", word)
        for extra in own[1].split(",") if own else []:
            _need(extra.strip() in extras, f"no extra {extra}")


def _python(words: list[str], root: Path) -> None:
    if words[0] == "-m":
        _need(words[1] == "tools.docs" or words[1] == "hdsafebo", f"no module {words[1]}")
        return
    script = root / words[0]
    _need(script.exists(), f"no file {words[0]}")
    text = script.read_text(encoding="utf-8")
    for word in words[1:]:
        _need(not word.startswith("--") or f'"{word}"' in text, f"{words[0]} has no option {word}")


def _dask(words: list[str], root: Path) -> None:
    from distributed.cli import dask_scheduler, dask_worker

    command = {"scheduler": dask_scheduler.main, "worker": dask_worker.main}[words[0]]
    known = {option for parameter in command.params for option in parameter.opts}
    for word in words[1:]:
        _need(not word.startswith("--") or word in known, f"dask {words[0]} has no option {word}")


def _anything(words: list[str], root: Path) -> None:
    """Of programs that are not this project's."""


def _need(holds: bool, message: str) -> None:
    if not holds:
        raise Refused(message)


_CHECKS: dict[str, Check] = {
    "make": _make,
    "hdsafebo": _hdsafebo,
    "dvc": _dvc,
    "pip": _pip,
    "python": _python,
    "dask": _dask,
    "git": _anything,
    "cd": _anything,
    "ssh": _anything,
    "apt-get": _anything,
}
