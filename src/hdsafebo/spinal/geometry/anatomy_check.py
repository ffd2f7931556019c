"""Whether an anatomy is possible: every part inside the next, every contact on the paddle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

import numpy as np

from hdsafebo.errors import AnatomyError
from hdsafebo.spinal.geometry.anatomy import CONTACT_LENGTH, CONTACT_WIDTH, Anatomy

_POSITIONS = ("segments", "rostral_end", "caudal_end", "paddle_rostral_edge")


def check_anatomy(anatomy: Anatomy) -> None:
    """Raise AnatomyError, naming the dimensions, unless the anatomy is possible."""
    for holds, message in _conditions(anatomy):
        if not holds:
            raise AnatomyError(message)


def _conditions(a: Anatomy) -> Iterator[tuple[bool, str]]:
    """What must hold, and what to say when it does not; the first failure ends the check."""
    for f in fields(a):
        if f.name not in _POSITIONS:
            yield getattr(a, f.name) > 0, f"{f.name} is {getattr(a, f.name):g} mm, expected more than 0"
    sac, canal = f"{a.sac_width:g} x {a.sac_depth:g} mm", f"{a.canal_width:g} x {a.canal_depth:g} mm"
    for s in a.segments:
        own = f"{s.length:g} mm long, {s.width:g} mm wide, {s.depth:g} mm deep"
        yield min(s.length, s.width, s.depth) > 0, f"segment {s.name} is {own}, expected more than 0"
        inside = s.width < a.sac_width and s.depth < a.sac_depth
        yield inside, f"the cord at {s.name} ({s.width:g} x {s.depth:g} mm) does not fit its sac ({sac})"
    dura = a.sac_outline(np.linspace(0, 2 * np.pi, 721), a.dura)
    yield _in_canal(a, *dura.T), f"the sac ({sac}) does not fit the canal ({canal})"
    corner = (a.paddle_width / 2, a.paddle_face + a.paddle_thickness)
    paddle = f"{a.paddle_width:g} mm wide, {a.paddle_thickness:g} mm thick"
    yield _in_canal(a, *np.array(corner)[:, None]), f"the paddle ({paddle}) does not fit the canal ({canal})"
    yield (
        max(a.canal_width, a.canal_depth) / 2 < a.body_radius,
        f"the canal ({canal}) does not fit the body (radius {a.body_radius:g} mm)",
    )
    yield from _lengthwise(a)


def _in_canal(a: Anatomy, x: np.ndarray, y: np.ndarray) -> bool:
    return bool(((2 * x / a.canal_width) ** 2 + (2 * y / a.canal_depth) ** 2).max() < 1)


def _lengthwise(a: Anatomy) -> Iterator[tuple[bool, str]]:
    top, bottom = a.paddle_rostral_edge, a.paddle_rostral_edge + a.paddle_length
    first, last = min(0.0, top), max(float(a.borders[-1]), bottom)
    yield (
        a.rostral_end < first and last < a.caudal_end,
        f"the model ({a.rostral_end:g} to {a.caudal_end:g} mm) does not hold cord and paddle "
        f"({first:g} to {last:g} mm)",
    )
    for number, (x, z) in enumerate(a.contacts(), start=1):
        across = abs(x) + CONTACT_WIDTH / 2 <= a.paddle_width / 2
        along = top <= z - CONTACT_LENGTH / 2 and z + CONTACT_LENGTH / 2 <= bottom
        yield (
            across and along,
            f"contact {number} at x = {x:g}, z = {z:g} mm lies off the paddle "
            f"({a.paddle_width:g} mm wide, {top:g} to {bottom:g} mm)",
        )
