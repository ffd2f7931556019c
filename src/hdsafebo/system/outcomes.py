"""Outcomes: the objective, and the measured quantities that must keep to limits.

Optimisers maximise, and keep safety values at or above thresholds. Signs are turned here and nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from hdsafebo.problem import Safety
from hdsafebo.system.errors import DescriptionError
from hdsafebo.system.values import Number, check_name, finite, set_plain

Direction = Literal["maximise", "minimise"]


@dataclass(frozen=True)
class Objective:
    """What is optimised.

    Attributes:
        name: column name.
        direction: "maximise" or "minimise".
        unit: is shown.
        noise: known standard deviation of one measurement; None lets the model find it.
    """

    name: str
    direction: Direction = "maximise"
    unit: str = ""
    noise: Number | None = None

    def __post_init__(self) -> None:
        check_name(self.name, "the objective")
        if self.direction not in ("maximise", "minimise"):
            raise DescriptionError(
                f"direction of objective {self.name!r} is {self.direction!r}; "
                "expected 'maximise' or 'minimise'"
            )
        set_plain(self, f"objective {self.name!r}", "noise")
        check_noise(self.noise, f"noise of objective {self.name!r}")

    @property
    def sign(self) -> float:
        """What measured values are multiplied with, so that more is better."""
        return 1.0 if self.direction == "maximise" else -1.0


@dataclass(frozen=True)
class Limit:
    """A measured quantity that must stay within a limit, or within two.

    Attributes:
        name: column name.
        at_least: a trial is unsafe below.
        at_most: a trial is unsafe above.
        unit: is shown.
        noise: known standard deviation of one measurement, which is then counted in: it is the measured value
            that is promised to keep the limit. None lets the model find the noise, and the promise is of the
            quantity itself.
    """

    name: str
    at_least: Number | None = None
    at_most: Number | None = None
    unit: str = ""
    noise: Number | None = None

    def __post_init__(self) -> None:
        check_name(self.name, "a limit")
        what = f"limit {self.name!r}"
        if self.at_least is None and self.at_most is None:
            raise DescriptionError(f"{what} has neither at_least nor at_most; expected one of them, or both")
        set_plain(self, what, "at_least", "at_most", "noise")
        low, high = self.at_least, self.at_most
        if low is not None and high is not None and not low < high:
            raise DescriptionError(f"{what}: at_least {low:g} is not below at_most {high:g}")
        check_noise(self.noise, f"noise of {what}")

    @property
    def sides(self) -> tuple[tuple[float, float], ...]:
        """For each side a sign and a threshold: safe when sign * value >= threshold."""
        found = []
        if self.at_least is not None:
            found.append((1.0, float(self.at_least)))
        if self.at_most is not None:
            found.append((-1.0, -float(self.at_most)))
        return tuple(found)

    def safety(self) -> tuple[Safety, ...]:
        """One safety function per side."""
        names = [self.name] if len(self.sides) == 1 else [f"{self.name} (low)", f"{self.name} (high)"]
        return tuple(Safety(name, threshold) for name, (_, threshold) in zip(names, self.sides, strict=True))

    def __str__(self) -> str:
        parts = [f">= {self.at_least:g}"] if self.at_least is not None else []
        parts += [f"<= {self.at_most:g}"] if self.at_most is not None else []
        return f"{self.name} {' and '.join(parts)}" + (f" {self.unit}" if self.unit else "")


def check_noise(noise: float | None, what: str) -> None:
    """Raise `DescriptionError` unless it is None or a positive standard deviation."""
    if noise is not None and not finite(noise, what) > 0:
        raise DescriptionError(f"{what} is {noise:g}; expected a positive standard deviation")
