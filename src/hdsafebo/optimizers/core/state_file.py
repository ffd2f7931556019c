"""One file that holds an optimiser's state: arrays and JSON, no code, and a digest of the whole file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from hdsafebo.errors import StateFileError
from hdsafebo.files.atomic import WriteError, replacing
from hdsafebo.files.bounded import read_bounded

FORMAT = 2
_MAX_BYTES = 4 << 30
_NO_DIGEST = "0" * 64

Arrays = Mapping[str, NDArray[Any]]


def write_state(path: Path, state: Mapping[str, Any], arrays: Arrays) -> None:
    """Write state and arrays to `path` in the safetensors format, state and digest in its header.

    The file is complete or the old one stays.

    Raises:
        StateFileError: the file cannot be written.
    """
    text = json.dumps({"format": FORMAT} | dict(state), allow_nan=False, sort_keys=True, default=_plain)
    content = bytearray(
        save(
            {name: np.ascontiguousarray(value) for name, value in arrays.items()},
            metadata={"state": _NO_DIGEST + text},  # one entry: the order of several would be random
        )
    )
    place = _place_of_digest(content)
    content[place : place + len(_NO_DIGEST)] = sha256(content).hexdigest().encode()
    try:
        with replacing(path) as temporary:
            temporary.write_bytes(content)
    except WriteError as error:
        raise StateFileError(str(error)) from error


def read_state(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """State and arrays that `write_state` wrote.

    Raises:
        StateFileError: the file is missing, damaged in a single bit even, too large or of another format.
    """
    content = bytearray(read_bounded(path, _MAX_BYTES, StateFileError))
    try:
        arrays = load(bytes(content))
        text = _header(content)["__metadata__"]["state"]
        digest, state = text[: len(_NO_DIGEST)], json.loads(text[len(_NO_DIGEST) :])
    except (SafetensorError, LookupError, ValueError, TypeError, RecursionError) as error:
        raise StateFileError(f"{path}: not the state of an optimiser: {error}") from error
    if not isinstance(state, dict) or state.get("format") != FORMAT:
        raise StateFileError(f"{path}: state of a format other than {FORMAT}")
    _check_digest(path, content, digest)
    return state, arrays


def _check_digest(path: Path, content: bytearray, expected: str) -> None:
    place = _place_of_digest(content)
    content[place : place + len(_NO_DIGEST)] = _NO_DIGEST.encode()
    if place < 0 or sha256(content).hexdigest() != expected:
        raise StateFileError(f"{path}: damaged state: its bytes are not those that were written")


def _place_of_digest(content: bytearray) -> int:
    """Where the digest stands in the header, before the state; -1 when there is none."""
    key = b'"state":"'
    length = int.from_bytes(content[:8], "little")
    found = content.find(key, 8, 8 + length)
    return found + len(key) if found >= 0 else -1


def _header(content: bytearray) -> Any:
    """JSON of the file's header, whose length its first eight bytes tell."""
    length = int.from_bytes(content[:8], "little")
    return json.loads(content[8 : 8 + length])


def _plain(value: Any) -> Any:
    """A number of NumPy's own as one of Python's."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} has no place in a state")
