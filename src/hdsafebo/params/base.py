"""What all blocks share: no unknown keys, no silent conversions, finite numbers."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

Scalar = bool | int | float | str | None
MethodSettings = dict[str, Scalar | dict[str, Scalar]]
"""Settings of a method by name; a block of settings is a table of its own."""
Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


def _name(text: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,79}", text):
        raise ValueError(
            f"{text!r:.100} is no name; expected at most 80 letters, digits, '_', '.' or '-', of which the "
            "first is a letter or a digit"
        )
    return text


Name = Annotated[str, AfterValidator(_name)]
"""What files and stage items are called after; it cannot lead out of the directory of a file."""


class Block(BaseModel):
    """A block of `params.yaml`: immutable, no unknown keys, no silent conversions."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)
