"""From YAML to checked parameters; every error names the key, the value and what was expected."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import read_mapping
from hdsafebo.params.model import Params


def load_params(path: Path) -> Params:
    """Read and check a parameter file.

    Args:
        path: a YAML file; only plain data is constructed from it.

    Raises:
        ParamsError: the file is missing, is no YAML mapping, or a key is unknown, of the wrong type
            or out of range. The message names file, key, value and what was expected.
    """
    return parse_params(read_mapping(path, ParamsError), source=str(path))


def parse_params(data: dict[str, Any], *, source: str = "params") -> Params:
    """Check parameters that were already read; see `load_params`."""
    try:
        return Params.model_validate(data)
    except ValidationError as error:
        raise ParamsError("\n".join(f"{source}: {_explain(e)}" for e in error.errors())) from None


def _explain(error: Any) -> str:
    """One line of a pydantic error: key, what is wrong, the value."""
    key = ".".join(str(part) for part in error["loc"] if part != "[key]") or "(top level)"
    message = error["msg"].removeprefix("Value error, ")
    if error["type"] == "extra_forbidden":
        return f"{key}: unknown key (value {_short(error['input'])}); {_valid_keys(error['loc'])}"
    if error["type"] in ("missing", "value_error"):
        return f"{key}: {message}"
    return f"{key}: {message}, got {_short(error['input'])}"


def _valid_keys(location: tuple[Any, ...]) -> str:
    """The keys that the block at `location[:-1]` has."""
    block: Any = Params
    for part in location[:-1]:
        field = getattr(block, "model_fields", {}).get(part)
        block = field.annotation if field is not None else None
    names = sorted(getattr(block, "model_fields", {}))
    return f"valid keys: {', '.join(names)}" if names else "remove it"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
