"""One file that holds an optimiser's state: arrays and JSON, no code."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import save

from hdsafebo.errors import StateFileError

FORMAT = 1
_MAX_BYTES = 4 << 30

Arrays = Mapping[str, NDArray[Any]]


def write_state(path: Path, state: Mapping[str, Any], arrays: Arrays) -> None:
    """Write state and arrays to `path` in the safetensors format, the state as JSON in its header.

    The file is complete or the old one stays: it is written beside, flushed to the disk, and renamed.

    Raises:
        StateFileError: the file cannot be written.
    """
    text = json.dumps({"format": FORMAT} | dict(state), allow_nan=False, sort_keys=True)
    content = save(
        {name: np.ascontiguousarray(value) for name, value in arrays.items()}, metadata={"state": text}
    )
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
        directory = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)
    except OSError as error:
        raise StateFileError(f"{path}: cannot be written: {error}") from error


def read_state(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """State and arrays that `write_state` wrote.

    Raises:
        StateFileError: the file is missing, damaged, too large or of another format.
    """
    from safetensors import safe_open

    try:
        if path.stat().st_size > _MAX_BYTES:
            raise StateFileError(f"{path}: {path.stat().st_size} bytes; expected at most {_MAX_BYTES}")
        with safe_open(path, framework="np") as file:
            metadata = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no mapping)
        state = json.loads(metadata["state"])
    except OSError as error:
        raise StateFileError(f"{path}: cannot be read: {error}") from error
    except (SafetensorError, KeyError, ValueError, RecursionError) as error:
        raise StateFileError(f"{path}: not the state of an optimiser: {error}") from error
    if not isinstance(state, dict) or state.get("format") != FORMAT:
        raise StateFileError(f"{path}: state of a format other than {FORMAT}")
    return state, arrays
