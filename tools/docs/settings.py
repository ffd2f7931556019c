"""A table of settings, from the fields of a pydantic model and its docstrings."""

from __future__ import annotations

import types
import typing
from dataclasses import dataclass
from typing import Any

import annotated_types as at
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from hdsafebo.params.base import MethodSettings, Scalar
from tools.docs.docstrings import attributes

_NAMES = {int: "whole number", float: "number", str: "text", bool: "true or false", type(None): "null"}
_KNOWN = [(MethodSettings, "settings by name"), (dict[str, Scalar], "settings by name"), (Scalar, "a value")]
_BOUNDS = {
    at.Gt: ("gt", "above"),
    at.Ge: ("ge", "at least"),
    at.Lt: ("lt", "below"),
    at.Le: ("le", "at most"),
}


@dataclass(frozen=True)
class Setting:
    """One setting.

    Attributes:
        name: within its block, dotted.
        kind: what it takes, in words.
        default: as text; "required" where there is none.
        meaning: from the docstring.
    """

    name: str
    kind: str
    default: str
    meaning: str


def settings_of(model: type[BaseModel], prefix: str = "") -> list[Setting]:
    """All settings of a model, those of nested blocks by dotted names."""
    meanings, found = attributes(model), []
    for name, field in model.model_fields.items():
        block = _block(field.annotation)
        if block is not None and field.default is not None:
            found += settings_of(block, f"{prefix}{name}.")
            continue
        found.append(Setting(prefix + name, _kind(field), _default(field), meanings.get(name, "")))
        named = _named_block(field.annotation)
        if block is not None:
            found += settings_of(block, f"{prefix}{name}.")
        if named is not None:
            found += settings_of(named, f"{prefix}{name}.NAME.")
    return found


def table(settings: list[Setting]) -> str:
    """The table in Markdown."""
    lines = ["| setting | takes | default | meaning |", "|---|---|---|---|"]
    lines += [f"| `{s.name}` | {s.kind} | {s.default} | {s.meaning.replace('|', '/')} |" for s in settings]
    return "\n".join(lines)


def _block(annotation: Any) -> type[BaseModel] | None:
    """The model behind an annotation, also where null is allowed."""
    options = typing.get_args(annotation) if _is_union(annotation) else (annotation,)
    models = [o for o in options if isinstance(o, type) and issubclass(o, BaseModel)]
    return models[0] if models else None


def _named_block(annotation: Any) -> type[BaseModel] | None:
    """The model of the values where an annotation is a mapping of names to blocks."""
    return _block(typing.get_args(annotation)[1]) if typing.get_origin(annotation) is dict else None


def _is_union(annotation: Any) -> bool:
    return typing.get_origin(annotation) in (types.UnionType, typing.Union)


def _kind(field: FieldInfo) -> str:
    words = _words(field.annotation)
    limits = [
        f"{word} {getattr(bound, attribute):g}"
        for bound in field.metadata
        for kind, (attribute, word) in _BOUNDS.items()
        if isinstance(bound, kind)
    ]
    value, null, _ = words.partition(" or null")
    return value + (f" {', '.join(limits)}" if limits else "") + null


def _words(annotation: Any) -> str:
    """A type in words."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    for known, words in _KNOWN:
        if annotation == known:
            return words
    if origin is typing.Annotated:
        return _words(arguments[0])
    if origin is typing.Literal:
        return "one of " + ", ".join(f"`{a}`" for a in arguments)
    if _is_union(annotation):
        return " or ".join(dict.fromkeys(_words(a) for a in arguments))
    if origin is list:
        return f"list of {_words(arguments[0])}"
    if origin is dict:
        return f"{_words(arguments[1])} by name"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "block"
    return _NAMES.get(annotation, str(getattr(annotation, "__name__", annotation)))


def _default(field: FieldInfo) -> str:
    if field.is_required() or field.default is PydanticUndefined:
        return "required"
    if field.default is None:
        return "`null`"
    if isinstance(field.default, bool):
        return f"`{str(field.default).lower()}`"
    return f"`{field.default}`"
