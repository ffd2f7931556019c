"""Pin every package of the environment with its hashes: requirements.lock and requirements-cuda.lock.

`uv pip compile` resolves the extras of pyproject.toml for every platform, and keeps a version that is pinned
already unless `--upgrade` is given. Two things are beyond that. PyTorch's wheels on PyPI need CUDA's
libraries on Linux, its CPU wheels do not: those libraries have a file of their own, which `make env` installs
for a CUDA build only. And a build of PyTorch from another index has hashes of its own: that of the build
which pip finds here is added.

    make lock
    make lock UPGRADE=--upgrade
"""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
LOCK, CUDA_LOCK = ROOT / "requirements.lock", ROOT / "requirements-cuda.lock"
OF_CUDA = ("nvidia-", "cuda-", "triton")
PYTHON = "3.11"  # the oldest that is supported


def main(options: list[str]) -> None:
    """Write both files."""
    with tempfile.TemporaryDirectory() as folder:
        compiled = Path(folder) / "compiled.lock"
        compiled.write_text("".join(f.read_text() for f in (LOCK, CUDA_LOCK) if f.exists()))
        compile_command = [sys.executable, "-m", "uv", "pip", "compile", "--quiet", "--universal"]
        compile_command += ["--python-version", PYTHON, "--generate-hashes", "--no-annotate", "--no-header"]
        compile_command += ["--extra", "dev", "--output-file", str(compiled), *options, "pyproject.toml"]
        subprocess.run(compile_command, cwd=ROOT, check=True)
        blocks = re.split(r"(?m)^(?=\S)", compiled.read_text())[1:]
    cuda = [block for block in blocks if block.startswith(OF_CUDA)]
    other = [_with_found_build(block) if block.startswith("torch==") else block for block in blocks]
    _write(
        LOCK, [block for block in other if not block.startswith(OF_CUDA)], "Every package of the environment"
    )
    _write(CUDA_LOCK, cuda, "What a CUDA build of PyTorch needs beside requirements.lock")


def _with_found_build(block: str) -> str:
    """The pin of PyTorch with the hash of the build that pip finds here, if PyPI's are others."""
    pin = block.split()[0]
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", folder, pin]
        subprocess.run(command, check=True)
        digests = [hashlib.sha256(wheel.read_bytes()).hexdigest() for wheel in Path(folder).iterdir()]
    lines = block.rstrip("\n").split(" \\\n")
    return " \\\n".join([*lines, *(f"    --hash=sha256:{d}" for d in digests if d not in block)]) + "\n"


def _write(path: Path, blocks: list[str], what: str) -> None:
    path.write_text(f"# {what}; `make lock` writes this file.\n{''.join(blocks)}", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
