"""JSON files of the pipeline, as data or as a checked model; a file that was not made is None."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from hdsafebo.errors import DatasetError
from hdsafebo.files.bounded import read_text

M = TypeVar("M", bound=BaseModel)


def read_json(path: Path) -> Any:
    """Content of a file; None without one.

    Raises:
        DatasetError: it cannot be read as JSON.
    """
    if not path.exists():
        return None
    try:
        return json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: cannot be read as JSON: {error}") from error


def read_model(path: Path, model: type[M]) -> M | None:
    """Content of a file as a model; None without a file.

    Raises:
        DatasetError: it cannot be read as JSON, or is no such model.
    """
    if not path.exists():
        return None
    try:
        return model.model_validate(read_json(path))
    except ValidationError as error:
        fault = error.errors()[0]
        raise DatasetError(f"{path}: {'.'.join(map(str, fault['loc']))}: {fault['msg']}") from None
