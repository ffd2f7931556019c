"""Checks of the texts that people enter."""

from __future__ import annotations

import re

from hdsafebo.session.errors import ProtocolError

LONGEST = 2000
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


def checked_name(who: str) -> str:
    """Name of the acting person; ProtocolError as for `checked_text`."""
    return checked_text(who, "who", longest=100)


def checked_text(value: str, what: str, *, needed: bool = True, longest: int = LONGEST) -> str:
    """Stripped text; ProtocolError when it is needed and empty, too long, or holds control characters."""
    words = value.strip()
    if needed and not words:
        raise ProtocolError(f"{what} is empty, expected some words")
    if len(words) > longest:
        raise ProtocolError(f"{what} has {len(words)} characters, expected at most {longest}")
    if any(ord(c) < 32 and c not in "\n\t" for c in words):
        raise ProtocolError(f"{what} holds control characters")
    try:
        words.encode("utf-8")
    except UnicodeEncodeError:
        raise ProtocolError(f"{what} is no valid text") from None
    return words


def parse_number(text: str) -> float | None:
    """The number that a text writes in plain decimal digits, such as -0.5 or 1e-3; None when it is none.

    Python's own `float` takes `1_200`, `nan`, `infinity` and digits of other scripts, too.
    """
    if not _NUMBER.fullmatch(text):
        return None
    number = float(text)
    return number if abs(number) < float("inf") else None
