"""Hard limits that are drawn tighter while a session runs.

Impedances rise over weeks, and limits turn out to have been too wide. A running session takes such changes
and no others: what is optimised, how it is measured and what counts as safe stay as they were.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from hdsafebo.session.definition import Definition
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
_MORE_CAREFUL: dict[tuple[str, ...], Direction] = _TIGHTER | {
    ("stimulator", "pulse_width_us"): "higher",
    ("stimulator", "contact_area_mm2"): "lower",
    ("scores", "threshold"): "higher",
    ("safety", "*", "at_least"): "higher",
    ("safety", "*", "at_most"): "lower",
    ("method", "settings", "alpha"): "higher",
    ("method", "settings", "beta"): "lower",  # the bound is mean + beta * deviation
    ("at_once",): "lower",
}
"""The same, and what a running session cannot take."""
_CARE = {place[0] for place in _MORE_CAREFUL} | {"priors"}
"""Blocks that say what may be delivered, and what counts as safe."""
_HOME = ("inputs", "*", "home")
_STEPS = (("inputs", "*", "max_step"), _HOME)

Change = tuple[str, Any, Any]
"""Place in the session file, value that is in force, value that is wanted."""


def changes(present: Definition, wanted: Definition) -> tuple[list[Change], list[Change]]:
    """Limits that the second of two definitions draws tighter, and everything else in which they differ."""
    tighter: list[Change] = []
    others: list[Change] = []
    for place, before, after in _differences(
        present.model_dump(mode="json"), wanted.model_dump(mode="json"), ()
    ):
        change = (".".join(map(str, place)), before, after)
        if _goes(_TIGHTER, place, before, after):
            tighter.append(change)
        elif not _follows(place, before, after, wanted):
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


def more_care(present: Definition, wanted: Definition) -> list[Change]:
    """Where the second of two definitions may ask for more care than the first, other than by tighter limits.

    What is known to be wider does not count, nor does what says nothing about care (a target, a seed, how
    outcomes are measured).
    """
    return [
        (".".join(map(str, place)), before, after)
        for place, before, after in _differences(_plain(present), _plain(wanted), ())
        if place[0] in _CARE
        and not _goes(_TIGHTER, place, before, after)
        and not _is_wider(place, before, after)
        and not _follows(place, before, after, wanted)
    ]


def describe(made: list[Change]) -> str:
    """Changes in one line."""
    return "; ".join(f"{place} is {after!r}, in force {before!r}" for place, before, after in made)


def _general(place: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple("*" if isinstance(part, int) else part for part in place)


def _goes(ways: Mapping[tuple[str, ...], Direction], place: tuple[Any, ...], before: Any, after: Any) -> bool:
    """Whether a number goes the way that is listed for its place."""
    general = _general(place)
    direction = ways.get(general) or ways.get((*general[:-1], "*"))
    if direction is None or not all(isinstance(v, int | float) for v in (before, after)):
        return False
    return bool(after < before if direction == "lower" else after > before)


def _is_wider(place: tuple[Any, ...], before: Any, after: Any) -> bool:
    """Whether a change is known to permit more, and nothing less."""
    if _general(place) in _STEPS:
        return after is None or _goes(_TIGHTER, place, after, before)
    if place[0] == "priors":
        return isinstance(before, list) and isinstance(after, list) and all(part in after for part in before)
    if place == ("stimulator", "current_split"):
        return bool(after == "equal")
    return _goes(_MORE_CAREFUL, place, after, before)


def _follows(place: tuple[Any, ...], before: Any, after: Any, wanted: Definition) -> bool:
    """Whether a change is that of a start that follows limits which have left it outside."""
    if _general(place) != _HOME or before is None:
        return False
    return bool(after == _clipped_home(wanted, place[1], before))


def _plain(definition: Definition) -> dict[str, Any]:
    """A definition as plain data, limits of measured quantities under one name."""
    data = definition.model_dump(mode="json")
    for rule in data.get("safety", []):
        if rule["threshold"] is not None:
            rule |= {"at_least": rule["threshold"], "threshold": None}
    return data


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
