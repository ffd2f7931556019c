"""Where a result comes from: git revision, and digests of parameters, inputs and code."""

from __future__ import annotations

import hashlib
import json
import subprocess
import token
from collections.abc import Iterable, Mapping
from io import StringIO
from itertools import accumulate
from pathlib import Path
from tokenize import TokenError, TokenInfo, generate_tokens
from typing import Any

from hdsafebo.files.bounded import open_regular, read_text

_BLOCK = 1 << 20
_LAYOUT = (token.NL, token.INDENT, token.DEDENT, token.ENDMARKER)
_GIT_TIMEOUT_S = 10


def digest_json(value: object) -> str:
    """SHA-256 of plain data, independent of the order of keys.

    Raises:
        TypeError: `value` holds something that is no plain data.
    """
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def digest_file(path: Path) -> str:
    """SHA-256 of a file's content, read in blocks; OSError for what is no regular file."""
    state = hashlib.sha256()
    with open_regular(path) as file:
        while block := file.read(_BLOCK):
            state.update(block)
    return state.hexdigest()


def digest_code(path: Path) -> str:
    """SHA-256 of a Python file without what changes no result: comments, docstrings, blank lines between.

    Better words must not cost hours of runs. What is left is text and not a syntax tree, whose form depends
    on the version of Python.

    Raises:
        SyntaxError: the file is no Python.
    """
    source = read_text(path)
    starts = [0, *accumulate(len(row) for row in StringIO(source))]
    state = hashlib.sha256()
    line: list[TokenInfo] = []
    comments: list[TokenInfo] = []
    try:
        for each in generate_tokens(StringIO(source).readline):
            if each.type == token.COMMENT:
                comments.append(each)
            elif each.type == token.NEWLINE:
                if [t.type for t in line] != [token.STRING]:  # a docstring is a line of its own
                    state.update(_without(comments, line, source, starts).encode())
                line, comments = [], []
            elif each.type not in _LAYOUT:
                line.append(each)
    except TokenError as error:
        raise SyntaxError(f"{path}: {error.args[0]}") from error
    return state.hexdigest()


def _without(comments: list[TokenInfo], line: list[TokenInfo], source: str, starts: list[int]) -> str:
    """A logical line with its indentation, without the comments in it."""
    begin, end = (starts[row - 1] + column for row, column in (line[0].start, line[-1].end))
    text, at = " " * line[0].start[1], begin
    for comment in comments:
        start = starts[comment.start[0] - 1] + comment.start[1]
        if begin < start < end:
            text += source[at:start].rstrip()
            at = start + len(comment.string)
    return text + source[at:end] + "\n"


def digest_paths(paths: Iterable[Path], root: Path) -> str:
    """SHA-256 of the names (relative to `root`) and contents of files and directory trees.

    A missing path is part of the digest, so that the digest changes when the path appears. Compiled Python
    files are left out; of Python files what computes counts (see `digest_code`).
    """
    contents: dict[str, str | None] = {}
    for path in paths:
        files = sorted(path.rglob("*")) if path.is_dir() else [path]
        for file in files:
            if file.is_dir() or "__pycache__" in file.parts:
                continue
            name = file.relative_to(root).as_posix() if file.is_relative_to(root) else str(file)
            digest = digest_code if file.suffix == ".py" else digest_file
            contents[name] = digest(file) if file.exists() else None
    return digest_json(contents)


def git_state(root: Path) -> tuple[str, bool] | None:
    """The revision that is checked out at `root` and whether tracked files differ from it.

    `dvc.lock` does not count: the pipeline itself writes this file while stages run. None without git,
    without a repository, and without a commit.
    """
    try:
        revision = _git(root, "rev-parse", "HEAD")
        changes = _git(root, "status", "--porcelain", "--untracked-files=no", "--", ".", ":!dvc.lock")
        return revision.strip(), bool(changes.strip())
    except (OSError, subprocess.SubprocessError):
        return None


def _git(root: Path, *arguments: str) -> str:
    command = ["git", "-C", str(root), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=_GIT_TIMEOUT_S).stdout


def stage_dependencies(dvc_file: Mapping[str, Any], stage: str, item: Mapping[str, str]) -> list[str]:
    """Paths that a stage of a parsed `dvc.yaml` depends on.

    Args:
        dvc_file: the parsed file.
        stage: name of the stage, without the suffix of a matrix item.
        item: values for `${item.KEY}` in the paths of a matrix stage.
    """
    entry = dvc_file.get("stages", {}).get(stage, {})
    paths = []
    for dependency in entry.get("deps", []):
        path = dependency if isinstance(dependency, str) else next(iter(dependency))
        for key, value in item.items():
            path = path.replace(f"${{item.{key}}}", value)
        paths.append(path)
    return paths
