"""Texts and numbers that people enter: one reading of each, whatever way they come in."""

from __future__ import annotations

import json
import re
import unicodedata
from numbers import Integral
from typing import Any

from hdsafebo.session.errors import ProtocolError

LONGEST = 2000
LONGEST_NAME = 100
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_WHOLE = re.compile(r"\d{1,9}", re.ASCII)
_INVISIBLE = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")  # Unicode categories; Cf turns text right to left


def checked_name(who: str) -> str:
    """Name of the acting person; ProtocolError as for `checked_text`, and for line breaks."""
    name = checked_text(who, "who", longest=LONGEST_NAME)
    if shown(name) != name:
        raise ProtocolError("who holds a line break or a tabulator, expected a name")
    return name


def checked_text(value: str, what: str, *, needed: bool = True, longest: int = LONGEST) -> str:
    """Stripped text in Unicode's composed form.

    Raises:
        ProtocolError: the text is needed and empty, too long, or holds characters that nobody sees (control
            characters, marks that turn the direction of writing).
    """
    words = unicodedata.normalize("NFC", value.strip())
    if needed and not words:
        raise ProtocolError(f"{what} is empty, expected some words")
    if len(words) > longest:
        raise ProtocolError(f"{what} has {len(words)} characters, expected at most {longest}")
    hidden = sorted({f"U+{ord(c):04X}" for c in words if c not in "\n\t" and _invisible(c)})
    if hidden:
        raise ProtocolError(f"{what} holds control characters: {', '.join(hidden[:5])}")
    return words


def checked_number(value: object, what: str) -> int:
    """Number of a suggestion or trial, NumPy's own too; ProtocolError for what is no whole number."""
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise ProtocolError(f"{what} is {value!r:.80}, expected its number")
    return int(value)


def trimmed_text(value: object, longest: int, default: str) -> str:
    """What can be kept of a text, whatever it is: visible characters, cut to a length; never an error."""
    text = value if isinstance(value, str) else ""
    words = "".join(c for c in text[: 4 * longest] if not _invisible(c)).strip()[:longest].strip()
    return words or default


def shown(text: str) -> str:
    """Text with every invisible character written out, such as \\u202e, so that it fits one line."""
    return "".join(c if not _invisible(c) else c.encode("unicode_escape").decode("ascii") for c in text)


def parse_number(text: str) -> float | None:
    """The number that a text writes in plain decimal digits, such as -0.5 or 1e-3; None when it is none.

    Python's own `float` takes `1_200`, `nan`, `infinity` and digits of other scripts, too.
    """
    if not _NUMBER.fullmatch(text):
        return None
    found = float(text)
    return found if abs(found) < float("inf") else None


def number(text: str) -> float:
    """As `parse_number`, for the command line; ValueError when the text is none."""
    found = parse_number(text)
    if found is None:
        raise ValueError(text)
    return found


def parse_whole_number(text: str) -> int | None:
    """The whole number that a text writes in decimal digits, at most nine; None when it is none."""
    return int(text) if _WHOLE.fullmatch(text) else None


def whole_number(text: str) -> int:
    """As `parse_whole_number`, for the command line; ValueError when the text is none."""
    found = parse_whole_number(text)
    if found is None:
        raise ValueError(text)
    return found


def parse_assignments(words: list[str]) -> dict[str, float]:
    """`NAME=VALUE` words as numbers by name.

    Raises:
        ProtocolError: no such word, no number, or a name that is given twice.
    """
    values: dict[str, float] = {}
    for word in words:
        name, equals, text = word.rpartition("=")
        number = parse_number(text)
        if not equals or not name or number is None:
            raise ProtocolError(f"{word!r}: expected NAME=VALUE with a number such as 0.5")
        if name in values:
            raise ProtocolError(f"{word!r}: {name} is given twice, {values[name]:g} before")
        values[name] = number
    return values


def parse_json(content: bytes, *, writable: bool = True) -> Any:
    """Plain data from JSON.

    Args:
        content: UTF-8.
        writable: refuse what could not be written as JSON again: halves of characters, numbers such as 1e400.

    Raises:
        ProtocolError: no JSON, NaN or an infinity, an object with a name twice, or not writable.
    """
    try:
        data = json.loads(content, object_pairs_hook=_once, parse_constant=_no_constant)
        if writable:
            json.dumps(data, allow_nan=False, ensure_ascii=False).encode()
        return data
    except (ValueError, RecursionError):
        raise ProtocolError("expected JSON, every name once and finite numbers only") from None


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    data = dict(pairs)
    if len(data) != len(pairs):
        raise ValueError("a name twice")
    return data


def _no_constant(name: str) -> Any:
    raise ValueError(name)


def _invisible(character: str) -> bool:
    return unicodedata.category(character) in _INVISIBLE
