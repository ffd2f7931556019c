"""What entries of each kind hold: every field of the log has a type, so nothing else can be handed in.

A payload stays the plain data that the log keeps; here it is only checked.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from hdsafebo.session.errors import AuditError

_DIGEST = r"^[0-9a-f]{64}$"
Digest = Annotated[str, Field(pattern=_DIGEST)]
Words = Annotated[str, Field(max_length=2000)]
Named = Annotated[str, Field(min_length=1, max_length=200)]
Number = Annotated[int, Field(ge=1)]
Scalar = bool | int | float | str | None


class _Fields(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class _Open(_Fields):
    """Fields of which methods and measurements may add others."""

    model_config = ConfigDict(extra="allow")


class _File(_Fields):
    name: Named
    sha256: Digest


class _Recording(_File):
    samples_sha256: Digest | None = None


class _Details(_Open):
    scores: dict[Named, float] = {}
    mu: list[float] = []
    recording: _Recording | None = None
    remark: Words = ""


class _Point(_Fields):
    """Either `values`, or `polarity` and `current_ma`; the kind of session says which."""

    values: list[float] | None = None
    polarity: Annotated[list[Literal[-1, 0, 1]], Field(min_length=16, max_length=16)] | None = None
    current_ma: float | None = None


class _Objective(_Fields):
    mean: float
    sd: float


class _Safety(_Fields):
    mean: float
    low: float
    high: float


class _Belief(_Open):
    objective: _Objective
    safety: dict[Named, _Safety]
    safe_probability: Annotated[float, Field(ge=0, le=1)]
    violation_bound: float | None = None
    trust_region_length: float | None = None
    marked_unsafe: bool = False
    __pydantic_extra__: dict[str, Scalar]


class _Result(_Fields):
    outcomes: dict[Named, float] | None
    safety: dict[Named, float] | None
    details: _Details


class _Initial(_Result):
    point: _Point
    time: Words | None = None


class _Definition(_Open):
    target: Named


class _Created(_Fields):
    session: Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
    definition: _Definition
    files: dict[Literal["initial", "embedding", "embedding_card", "candidates"], _File]
    initial: list[_Initial]
    version: Named
    source: Annotated[str, Field(max_length=4096)] = ""


class _Suggested(_Fields):
    based_on: Number
    target: Named
    point: _Point
    belief: _Belief


class _Abstained(_Fields):
    based_on: Number
    target: Named
    reason: str


class _Approved(_Fields):
    suggestion: Number


class _Modified(_Fields):
    suggestion: Number
    point: _Point
    reason: Words


class _Refused(_Fields):
    suggestion: Number
    reason: Words


class _Manual(_Fields):
    point: _Point
    reason: Words


class _Recorded(_Result):
    trial: Number
    failure: Words | None
    delivered: bool


class _TargetSwitched(_Fields):
    target: Named


class _Stopped(_Fields):
    """`pressed` names the stop that was obeyed before it could be written here, `at` says when."""

    reason: Words
    pressed: Words = ""
    at: Words = ""


class _Noted(_Fields):
    text: Words


class _Tightened(_Fields):
    definition: _Definition
    reason: Words


class _Converted(_Fields):
    entries: Annotated[int, Field(ge=0)]
    version: Named


class _Repaired(_Fields):
    damage: list[str]


class _Nothing(_Fields):
    pass


KINDS: dict[str, type[_Fields]] = {
    "created": _Created,
    "suggested": _Suggested,
    "abstained": _Abstained,
    "approved": _Approved,
    "modified": _Modified,
    "refused": _Refused,
    "manual": _Manual,
    "recorded": _Recorded,
    "target_switched": _TargetSwitched,
    "stopped": _Stopped,
    "resumed": _Nothing,
    "noted": _Noted,
    "tightened": _Tightened,
    "converted": _Converted,
    "repaired": _Repaired,
}


def check_payload(kind: str, payload: Any, source: str) -> None:
    """AuditError naming the first field that entries of a kind do not have, lack, or hold otherwise."""
    try:
        KINDS[kind].model_validate(payload)
    except ValidationError as error:
        first = error.errors(include_input=False)[0]
        key = ".".join(str(part)[:40] for part in first["loc"]) or "the payload"
        raise AuditError(f"{source} ({kind}): {key}: {first['msg']}") from None
