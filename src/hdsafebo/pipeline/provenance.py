"""Where a result comes from: git revision, and digests of parameters, inputs and code."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

_BLOCK = 1 << 20
_GIT_TIMEOUT_S = 10


def digest_json(value: object) -> str:
    """SHA-256 of plain data, independent of the order of keys.

    Raises:
        TypeError: `value` holds something that is no plain data.
    """
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def digest_file(path: Path) -> str:
    """SHA-256 of a file's content, read in blocks."""
    state = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            state.update(block)
    return state.hexdigest()


def digest_paths(paths: Iterable[Path], root: Path) -> str:
    """SHA-256 of the names (relative to `root`) and contents of files and directory trees.

    A missing path is part of the digest, so that the digest changes when the path appears.
    Compiled Python files are left out.
    """
    contents: dict[str, str | None] = {}
    for path in paths:
        files = sorted(path.rglob("*")) if path.is_dir() else [path]
        for file in files:
            if file.is_dir() or "__pycache__" in file.parts:
                continue
            name = file.relative_to(root).as_posix() if file.is_relative_to(root) else str(file)
            contents[name] = digest_file(file) if file.exists() else None
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
