"""Files of embeddings: numbers in a safetensors file, and a JSON card beside it that says what they are.

Nothing in them is executed, and sizes are checked before anything is read: a card says which class with
which settings, the class says which tensors of which shapes, and the file must hold exactly those.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError

from hdsafebo.errors import EmbeddingFileError
from hdsafebo.files.atomic import replacing, write_json
from hdsafebo.files.bounded import read_bounded

Tensor = NDArray[np.floating]

TENSOR_SUFFIX, CARD_SUFFIX = ".safetensors", ".json"
MAX_CARD_BYTES = 2**20
MAX_TENSOR_BYTES = 2**30
HEADER_ROOM_BYTES = 2**16  # a safetensors header describes each tensor in some hundred bytes


class TensorSpec(NamedTuple):
    """Shape and dtype (`float32` or `float64`) that a stored tensor must have."""

    shape: tuple[int, ...]
    dtype: str


class Card(BaseModel):
    """The JSON card.

    Attributes:
        format: marks the file as ours.
        version: of the format.
        kind: registry name.
        input_dim: D.
        latent_dim: d.
        settings: constructor settings.
        training: how the fit went.
        sha256: of the safetensors file.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    format: Literal["hdsafebo-embedding"] = "hdsafebo-embedding"
    version: Literal[1] = 1
    kind: str
    input_dim: Annotated[int, Field(ge=1)]
    latent_dim: Annotated[int, Field(ge=1)]
    settings: dict[str, JsonValue]
    training: dict[str, JsonValue]
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


def write_files(path: Path, tensors: Mapping[str, Tensor], **card: Any) -> None:
    """Write `path` (`.safetensors`) and its card (`.json`, the fields of `Card` but for the checksum).

    Raises:
        EmbeddingFileError: another suffix, or a file that cannot be written. A card that was not written
            does not fit the tensors, which are then refused.
    """
    from safetensors.numpy import save

    card_path = card_of(path)
    data = save({key: np.ascontiguousarray(value) for key, value in tensors.items()})
    filled = Card(sha256=hashlib.sha256(data).hexdigest(), **json.loads(json.dumps(card)))
    with replacing(path, EmbeddingFileError) as temporary:
        temporary.write_bytes(data)
    write_json(card_path, filled.model_dump(mode="json"), EmbeddingFileError, sort_keys=True)


def read_card(path: Path) -> Card:
    """The card of an embedding file; EmbeddingFileError if it is missing or damaged."""
    card_path = card_of(path)
    data = read_bounded(card_path, MAX_CARD_BYTES, EmbeddingFileError)
    try:
        return Card.model_validate_json(data)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "the card"
        raise EmbeddingFileError(f"{card_path}: {key}: {first['msg']}") from None


def card_of(path: Path) -> Path:
    """Path of the card beside a `.safetensors` file."""
    if path.suffix != TENSOR_SUFFIX:
        raise EmbeddingFileError(f"{path}: expected a file name that ends in {TENSOR_SUFFIX}")
    return path.with_suffix(CARD_SUFFIX)


def read_tensors(path: Path, specs: Mapping[str, TensorSpec], sha256: str) -> dict[str, Tensor]:
    """The tensors of an embedding file.

    Args:
        path: the `.safetensors` file.
        specs: exactly the tensors that it must hold.
        sha256: of the file, from its card.

    Raises:
        EmbeddingFileError: the file is missing, too large, damaged, or holds other tensors.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    size = sum(math.prod(spec.shape) * np.dtype(spec.dtype).itemsize for spec in specs.values())
    if size > MAX_TENSOR_BYTES:
        raise EmbeddingFileError(
            f"{card_of(path)}: an embedding of {size} bytes, expected at most {MAX_TENSOR_BYTES}"
        )
    data = read_bounded(path, size + HEADER_ROOM_BYTES, EmbeddingFileError)
    if hashlib.sha256(data).hexdigest() != sha256:
        raise EmbeddingFileError(f"{path}: its SHA-256 is not the one in its card; it was changed or cut off")
    try:
        tensors = load(data)
    except (SafetensorError, ValueError, KeyError) as error:
        raise EmbeddingFileError(f"{path}: no safetensors file: {error}") from None
    if set(tensors) != set(specs):
        raise EmbeddingFileError(f"{path}: holds the tensors {sorted(tensors)}, expected {sorted(specs)}")
    for name, (shape, dtype) in specs.items():
        found = tensors[name]
        if found.shape != shape or found.dtype != dtype:
            raise EmbeddingFileError(
                f"{path}: tensor {name!r} is {found.dtype} {found.shape}, expected {dtype} {shape}"
            )
        if not np.isfinite(found).all():
            raise EmbeddingFileError(f"{path}: tensor {name!r} holds NaN or infinite values")
    return tensors
