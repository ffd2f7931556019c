"""Ways to spoil a file: what an attacker would put in its place, and what a bad disk makes of it."""

from __future__ import annotations

import io
import os
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np


class _Executed:
    """Unpickling it makes the canary file."""

    def __init__(self, canary: Path) -> None:
        self._canary = canary

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        return os.mkdir, (str(self._canary),)


def _pickle(valid: bytes, canary: Path) -> bytes:
    return pickle.dumps(_Executed(canary))


def _torch(valid: bytes, canary: Path) -> bytes:
    """What `torch.save` writes: a ZIP archive with a pickle."""
    return _zip({"archive/data.pkl": pickle.dumps(_Executed(canary)), "archive/version": b"3\n"})


def _old_torch(valid: bytes, canary: Path) -> bytes:
    """What `torch.save` wrote before its version 1.6: a magic number and pickles."""
    return pickle.dumps(0x1950A86A20F9469CFC6C) + pickle.dumps(_Executed(canary))


def _object_arrays(valid: bytes, canary: Path) -> bytes:
    """An .npz whose arrays are objects, under the names of the arrays that are expected."""
    names = ["x", "bounds"]
    if zipfile.is_zipfile(io.BytesIO(valid)):
        names = [Path(name).stem for name in zipfile.ZipFile(io.BytesIO(valid)).namelist()]
    buffer = io.BytesIO()
    hostile = np.array([_Executed(canary)], dtype=object)
    np.savez(buffer, **dict.fromkeys(names, hostile))
    return buffer.getvalue()


def _object_array(valid: bytes, canary: Path) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.array([_Executed(canary)], dtype=object), allow_pickle=True)
    return buffer.getvalue()


def _zip_slip(valid: bytes, canary: Path) -> bytes:
    climbing = "../" * 30 + str(canary).lstrip("/")
    return _zip({f"{climbing}/there": b"x", str(canary): b"x", "../slipped": b"x"})


def _zip(members: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def _python_yaml(valid: bytes, canary: Path) -> bytes:
    return f"profile: !!python/object/apply:os.mkdir ['{canary}']\n".encode()


def _nothing(valid: bytes, canary: Path) -> bytes:
    return b""


def _noise(valid: bytes, canary: Path) -> bytes:
    return np.random.default_rng(0).bytes(3000)


def _zeros(valid: bytes, canary: Path) -> bytes:
    return bytes(4096)


def _deep(valid: bytes, canary: Path) -> bytes:
    return b"[" * 1_000


HOSTILE: dict[str, Callable[[bytes, Path], bytes]] = {
    "pickle": _pickle,
    "torch file": _torch,
    "old torch file": _old_torch,
    "npz of objects": _object_arrays,
    "npy of objects": _object_array,
    "zip slip": _zip_slip,
    "Python in YAML": _python_yaml,
    "nothing": _nothing,
    "noise": _noise,
    "zeros": _zeros,
    "deep nesting": _deep,
}


def cut(valid: bytes, share: float) -> bytes:
    """The first part of it."""
    return valid[: round(share * len(valid))]


def flipped(valid: bytes, rng: np.random.Generator) -> bytes:
    """With one bit the other way round."""
    content = bytearray(valid)
    content[rng.integers(len(content))] ^= 1 << int(rng.integers(8))
    return bytes(content)
