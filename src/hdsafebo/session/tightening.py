"""Hard limits that are drawn tighter while a session runs.

Impedances rise over weeks, and limits turn out to have been too wide. A running session takes such changes
and no others: what is optimised, how it is measured and what counts as safe stay as they were.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from hdsafebo.errors import HdSafeBOError
from hdsafebo.session.definition import Definition, load_definition, parse_definition
from hdsafebo.session.errors import DefinitionError

Direction = Literal["lower", "higher"]
_TIGHTER: dict[tuple[str, ...], Direction] = {
    ("limits", "*"): "lower",
    ("stimulator", "compliance_v"): "lower",
    ("stimulator", "impedance_ohm", "*"): "higher",
    ("inputs", "*", "upper"): "lower",
    ("inputs", "*", "max_step"): "lower",
    ("inputs", "*", "lower"): "higher",
}
"""Hard limits by their place in a session file, and which way is tighter."""
_HOME = ("inputs", "*", "home")

Change = tuple[str, Any, Any]
"""Place in the session file, value that is in force, value that is wanted."""


def changes(present: Definition, wanted: Definition) -> tuple[list[Change], list[Change]]:
    """Limits that the second of two definitions draws tighter, and everything else in which they differ."""
    tighter: list[Change] = []
    others: list[Change] = []
    for place, before, after in _differences(
        present.model_dump(mode="json"), wanted.model_dump(mode="json"), ()
    ):
        general = tuple("*" if isinstance(part, int) else part for part in place)
        direction = _TIGHTER.get(general) or _TIGHTER.get((*general[:-1], "*"))
        numbers = all(isinstance(v, int | float) for v in (before, after))
        ordered = numbers and (after < before if direction == "lower" else after > before)
        change = (".".join(map(str, place)), before, after)
        if direction and ordered:
            tighter.append(change)
        elif general == _HOME and before is not None and after == _clipped_home(wanted, place[1], before):
            continue  # the start follows limits that have left it outside
        else:
            others.append(change)
    return tighter, others


def require_tighter(present: Definition, wanted: Definition) -> list[Change]:
    """The limits that are drawn tighter.

    Raises:
        DefinitionError: there is none, or something else differs; the message names it.
    """
    tighter, others = changes(present, wanted)
    if others:
        raise DefinitionError(
            f"a running session takes tighter hard limits and nothing else, but: {describe(others)}"
        )
    if not tighter:
        raise DefinitionError("no hard limit is tighter than the one that is in force")
    return tighter


def require_same_limits(source: str, present: dict[str, Any]) -> None:
    """Nothing, while a session file draws no limit tighter than in force; else it must be applied first.

    A file that is gone, unreadable, or of another session (another name or kind) says nothing, and wider
    limits in it have no effect.

    Args:
        source: path of the session file; may be empty.
        present: definition that is in force.

    Raises:
        DefinitionError: the file draws a limit tighter.
    """
    if not source:
        return
    try:
        wanted = load_definition(Path(source))
    except (HdSafeBOError, OSError, ValueError):
        return
    held = parse_definition(present)
    if (wanted.name, wanted.kind) != (held.name, held.kind):
        return
    tighter, _ = changes(held, wanted)
    if tighter:
        raise DefinitionError(
            f"{source} was tightened after the session was made: {describe(tighter)}. Apply it with "
            "`hdsafebo session tighten`, or take the change back"
        )


def describe(made: list[Change]) -> str:
    """Changes in one line."""
    return "; ".join(f"{place} is {after!r}, in force {before!r}" for place, before, after in made)


def _differences(
    before: Any, after: Any, place: tuple[Any, ...]
) -> Iterator[tuple[tuple[Any, ...], Any, Any]]:
    if isinstance(before, dict) and isinstance(after, dict):
        for key in dict.fromkeys([*before, *after]):
            yield from _differences(before.get(key), after.get(key), (*place, key))
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for number, (a, b) in enumerate(zip(before, after, strict=True)):
            yield from _differences(a, b, (*place, number))
    elif before != after:
        yield place, before, after


def _clipped_home(wanted: Definition, number: int, home: float) -> float:
    """The former start of an input, moved into its new limits."""
    new = wanted.model_dump(mode="json")["inputs"][number]
    return float(min(max(home, new["lower"]), new["upper"]))
