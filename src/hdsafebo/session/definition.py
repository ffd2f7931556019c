"""The session file: what is optimised, by which method, within which hard limits.

A session file is YAML of one of three kinds: `stimulation` (16 contacts and a current, EMG and scores),
`box` (any continuous inputs) and `list` (a finite table of inputs). Hard limits have no defaults: a file
without them starts no session.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, Field, TypeAdapter, ValidationError, ValidationInfo, model_validator

from hdsafebo.files.yaml import read_mapping
from hdsafebo.params import Block, Count, Positive, Scalar
from hdsafebo.session.errors import DefinitionError
from hdsafebo.session.measuring.emg import Emg
from hdsafebo.session.measuring.stimulator import StimulationLimits, Stimulator

Finite = Annotated[float, Field(allow_inf_nan=False)]


def _visible(name: str, info: ValidationInfo) -> str:
    """The name, unless a new session would show it as another; sessions that have begun open as they are."""
    if info.context == NEW and not name.isprintable():
        hidden = next(c for c in name if not c.isprintable())
        raise ValueError(f"has a character that cannot be seen, U+{ord(hidden):04X}")
    return name


NEW = "new"
"""Context of a definition that is read from a session file, and not from the log of a session."""
Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[^\s,;:/\\]+$"), AfterValidator(_visible)]


class MethodChoice(Block):
    """The optimiser.

    Attributes:
        name: one of the optimisers that need no evaluation of their own (`hdsafebo methods` lists them), or
            `hdsafebo_shortlist` (sessions only; a finite set).
        settings: its constructor settings, such as `alpha`.
    """

    name: str = "hdsafebo_local"
    settings: dict[str, Scalar] = {}


class Scores(Block):
    """Safety scores asked from several people after each trial; the lowest counts.

    Attributes:
        raters: who is asked.
        minimum, maximum: ends of the scale; higher is safer.
        threshold: a trial is safe from this score up.
    """

    raters: Annotated[list[Name], Field(min_length=1)] = ["patient", "therapist"]
    minimum: Finite
    maximum: Finite
    threshold: Finite

    @model_validator(mode="after")
    def _ordered(self) -> Scores:
        if not self.minimum < self.threshold <= self.maximum:
            raise ValueError(
                "expected minimum < threshold <= maximum, got "
                f"{self.minimum}, {self.threshold}, {self.maximum}"
            )
        if len(set(self.raters)) != len(self.raters):
            raise ValueError(f"raters holds a name twice: {self.raters}")
        return self


class PoleCount(Block):
    """With so many cathodes, the numbers of anodes that may be suggested."""

    cathodes: Count
    anodes: Annotated[list[Count], Field(min_length=1)]


class Priors(Block):
    """Clinical priors: what may be suggested at all.

    Attributes:
        poles: allowed numbers of cathodes and anodes.
        currents_ma: the currents to choose from, increasing.
    """

    poles: Annotated[list[PoleCount], Field(min_length=1)]
    currents_ma: Annotated[list[Positive], Field(min_length=1)]

    @model_validator(mode="after")
    def _increasing(self) -> Priors:
        if any(b <= a for a, b in pairwise(self.currents_ma)):
            raise ValueError(f"currents_ma must increase, got {self.currents_ma}")
        return self


class _Common(Block):
    """What the kinds share.

    Attributes:
        name: of the session, for people.
        seed: of the optimiser.
        target: objective that is optimised first.
        method: the optimiser.
    """

    name: Annotated[str, Field(min_length=1, max_length=200)]
    seed: Annotated[int, Field(ge=0, lt=2**31)]
    target: Name
    method: MethodChoice = MethodChoice()


class StimulationDefinition(_Common):
    """Spinal cord stimulation: objective = clinical selectivity of the target muscle, safety = scores."""

    kind: Literal["stimulation"]
    emg: Emg
    scores: Scores
    priors: Priors
    stimulator: Stimulator
    limits: StimulationLimits

    @model_validator(mode="after")
    def _reachable(self) -> StimulationDefinition:
        if self.target not in self.emg.muscles:
            raise ValueError(
                f"target {self.target!r} is no muscle of emg.muscles ({', '.join(self.emg.muscles)})"
            )
        if self.priors.currents_ma[0] > self.limits.restart_current_ma:
            raise ValueError(
                f"priors.currents_ma starts at {self.priors.currents_ma[0]} mA, above "
                f"limits.restart_current_ma ({self.limits.restart_current_ma}): no first trial is possible"
            )
        return self


class Input(Block):
    """One input of a generic problem, with its hard limits.

    Attributes:
        name: column name.
        lower, upper: hard limits.
        max_step: largest change from the value that was set last; None where nothing moves in steps.
        home: value at a start and after a pause, from which the first step is limited; None without steps.
    """

    name: Name
    lower: Finite
    upper: Finite
    max_step: Positive | None = None
    home: Finite | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Input:
        if self.lower > self.upper:
            raise ValueError(f"expected lower <= upper, got {self.lower}, {self.upper}")
        if (self.max_step is None) != (self.home is None):
            raise ValueError(
                f"max_step is {self.max_step} and home is {self.home}; expected both, or neither where "
                "nothing moves in steps"
            )
        if self.home is not None and not self.lower <= self.home <= self.upper:
            raise ValueError(f"expected lower <= home <= upper, got {self.lower}, {self.home}, {self.upper}")
        return self


class SafetyRule(Block):
    """A measured quantity with a limit on one side.

    Attributes:
        name: of the quantity.
        at_least, at_most: the limit; one of them.
        threshold: an older name of `at_least`.
    """

    name: Name
    threshold: Finite | None = None
    at_least: Finite | None = None
    at_most: Finite | None = None

    @model_validator(mode="after")
    def _one_side(self) -> SafetyRule:
        given = [k for k in ("threshold", "at_least", "at_most") if getattr(self, k) is not None]
        if len(given) != 1:
            raise ValueError(
                f"{self.name}: limits given: {', '.join(given) or 'none'}; expected at_least or at_most"
            )
        return self

    @property
    def sign(self) -> float:
        """1 where larger values are safer, -1 where smaller ones are."""
        return 1.0 if self.at_most is None else -1.0

    @property
    def limit(self) -> float:
        """In the quantity's own sign."""
        return next(v for v in (self.threshold, self.at_least, self.at_most) if v is not None)


class _Generic(_Common):
    """Any system: named inputs, named outcomes (each can be a target), safety functions.

    Attributes:
        inputs: the inputs and their limits.
        outcomes: measured quantities that can be optimised (larger is better).
        safety: measured quantities that must keep limits.
        at_once: so many trials may run at the same time, such as one per robot.
    """

    inputs: Annotated[list[Input], Field(min_length=1)]
    outcomes: Annotated[list[Name], Field(min_length=1)]
    safety: Annotated[list[SafetyRule], Field(min_length=1)]
    at_once: Annotated[Count, Field(le=100)] = 1

    @model_validator(mode="after")
    def _names(self) -> _Generic:
        names = [i.name for i in self.inputs] + self.outcomes + [s.name for s in self.safety]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise ValueError(f"inputs, outcomes and safety share the names {', '.join(twice)}")
        if self.target not in self.outcomes:
            raise ValueError(f"target {self.target!r} is none of the outcomes ({', '.join(self.outcomes)})")
        stepping = [i.name for i in self.inputs if i.max_step is not None]
        if self.at_once > 1 and stepping:
            raise ValueError(
                f"at_once is {self.at_once}, and {', '.join(stepping)} may only move in steps from the one "
                "trial before; expected at_once: 1, or no max_step and home"
            )
        return self


class BoxDefinition(_Generic):
    """Every point of the box may be evaluated."""

    kind: Literal["box"]


class ListDefinition(_Generic):
    """Only the rows of a table may be evaluated.

    Attributes:
        candidates: the table, a CSV file beside the session file with one column per input.
    """

    kind: Literal["list"]
    candidates: str


GenericDefinition = BoxDefinition | ListDefinition
Definition = StimulationDefinition | BoxDefinition | ListDefinition
_ADAPTER: TypeAdapter[Definition] = TypeAdapter(Annotated[Definition, Field(discriminator="kind")])
_KINDS = [get_args(d.model_fields["kind"].annotation)[0] for d in get_args(Definition)]


def load_definition(path: Path) -> Definition:
    """Read and check a session file; only plain data is constructed from it.

    Raises:
        DefinitionError: the file is missing, too large or no YAML mapping, or a key is missing, unknown,
            there twice, of the wrong type or out of range; the message names it.
    """
    data = read_mapping(path, DefinitionError)
    return parse_definition(data, source=str(path), context=NEW)


def parse_definition(
    data: dict[str, Any], *, source: str = "session file", context: str | None = None
) -> Definition:
    """Check a definition that was already read; see `load_definition`."""
    try:
        return _ADAPTER.validate_python(data, context=context)
    except ValidationError as error:
        raise DefinitionError("\n".join(f"{source}: {_explain(e)}" for e in error.errors())) from None


def _explain(error: Any) -> str:
    """One line of a pydantic error: key, what is wrong, the value."""
    if error["type"].startswith("union_tag"):
        return f"kind: expected one of {', '.join(_KINDS)}"
    key = ".".join(str(part) for part in error["loc"][1:]) or "(top level)"
    message = error["msg"].removeprefix("Value error, ")
    if error["type"] == "missing":
        return f"{key}: is missing and has no default"
    if error["type"] == "value_error":
        return f"{key}: {message}"
    if error["type"] == "extra_forbidden":
        return f"{key}: unknown key"
    value = repr(error["input"])
    return f"{key}: {message}, got {value if len(value) <= 80 else value[:77] + '...'}"
