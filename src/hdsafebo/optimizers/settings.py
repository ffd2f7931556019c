"""Settings of an optimiser: immutable, checked, named in every error."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from inspect import Parameter, Signature, signature
from typing import Any, Literal, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from hdsafebo.errors import OptimisticWarning, ParamsError
from hdsafebo.gp.safe_set import alpha_of, beta_of

EmptySafeSet = Literal["mark", "abstain"]
S = TypeVar("S", bound="OptimizerSettings")


class OptimizerSettings(BaseModel):
    """Base of all settings. What a method does not use is unknown to it: no setting is ignored."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class CentreSettings(OptimizerSettings):
    """Settings of a method that starts from the best safe trial.

    Attributes:
        empty_safe_set: what a method does without a safe trial, and, where it has a safe set, when too few
            candidates are believed safe: "abstain" proposes fewer trials, and raises `NoSafePointError` when
            none is left; "mark" proposes the most probably safe ones all the same and marks them in
            `Trials.marked_unsafe`.
    """

    empty_safe_set: EmptySafeSet = "abstain"


class ModelSettings(OptimizerSettings):
    """Settings of a method that consults the Gaussian processes, at least for what it says of each trial.

    Attributes:
        beta: a point is in the safe set when mu + beta * sigma >= h (paper: 2 in all experiments).
        alpha: safe probability to promise instead, beta = Phi^-1(1 - alpha) (paper, Proposition 1).
        max_fitted_trials: the surrogate is fitted only to so many completed trials, those nearest to the best
            feasible one (see `nearest_trials`), so that a round costs the same however many there are; None
            fits it to all. What is believed safe, and each safe probability, is then given those trials
            alone: a violation that was seen elsewhere is forgotten, and far from the centre the prior, which
            follows the trials that were kept, decides. Proposition 1 takes the data as given, not chosen by
            their outcomes, so it holds for the neighbourhood of the centre only as far as the trials left
            out say nothing about it. The models of their own that some baselines fit are not bounded.
    """

    beta: float = 2.0
    alpha: float | None = Field(default=None, gt=0, lt=1)
    max_fitted_trials: int | None = Field(default=None, ge=1)

    @model_validator(mode="after")
    def _one_confidence(self) -> ModelSettings:
        if self.alpha is not None and "beta" in self.model_fields_set:
            raise ValueError(
                f"alpha ({self.alpha}) and beta ({self.beta}) set the same thing; give one of them"
            )
        return self

    @property
    def confidence(self) -> float:
        """The beta that is used: as given, or from alpha."""
        return self.beta if self.alpha is None else beta_of(self.alpha)


class SafeSetSettings(CentreSettings, ModelSettings):
    """Settings of a method whose trials are believed safe, or marked, or not proposed."""


def constructor_signature(construct: Callable[..., None], kind: type[OptimizerSettings]) -> Signature:
    """The signature of a method's class, with its settings by name, for `help` and editors.

    Args:
        construct: the constructor, which takes any settings.
        kind: the settings of the method.
    """
    own = [p for p in signature(construct).parameters.values() if p.kind != Parameter.VAR_KEYWORD]
    settings = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=field.default, annotation=field.annotation)
        for name, field in kind.model_fields.items()
    ]
    return Signature([*own[1:], *settings])


def check_settings(
    kind: type[S], method: str, given: OptimizerSettings | None, values: Mapping[str, Any]
) -> S:
    """Settings of a method, given whole or by name.

    Args:
        kind: of the method.
        method: its name, for messages.
        given: an instance of `kind`; None takes `values`.
        values: settings by name.

    Raises:
        ParamsError: names what is unknown, of the wrong type or out of range; or both were given.
    """
    if given is not None:
        if values:
            raise ParamsError(
                f"method {method!r}: settings are given whole and by name ({', '.join(values)}); expected one"
            )
        if not isinstance(given, kind):
            raise ParamsError(
                f"method {method!r}: settings are {type(given).__name__}; expected {kind.__name__}"
            )
        return given
    try:
        return kind.model_validate(dict(values))
    except ValidationError as error:
        raise ParamsError("; ".join(_explain(kind, method, item) for item in error.errors())) from None


def warn_of_an_optimistic_default(method: str, settings: OptimizerSettings) -> None:
    """Warn where a default promises less than an even chance of being safe, unless it was chosen."""
    if not isinstance(settings, SafeSetSettings) or settings.model_fields_set & {"alpha", "beta"}:
        return
    promised = alpha_of(settings.confidence)
    if promised < 0.5:
        warnings.warn(
            f"{method} takes beta = {settings.confidence:g}, as published, which promises each trial a safe "
            f"probability of {promised:.2g} and no more; pass alpha (such as 0.95), or beta to choose it, or "
            "use hdsafebo_local",
            OptimisticWarning,
            stacklevel=3,
        )


def _explain(kind: type[OptimizerSettings], method: str, error: Any) -> str:
    key = ".".join(str(part) for part in error["loc"])
    if error["type"] == "extra_forbidden":
        valid = ", ".join(_valid(kind, error["loc"]))
        return f"method {method!r}: unknown setting {key!r}; valid settings: {valid}"
    message = error["msg"].removeprefix("Value error, ")
    if error["type"] == "value_error":
        return f"method {method!r}: {message}"
    return f"method {method!r}: setting {key!r}: {message}, got {error['input']!r}"


def _valid(kind: type[BaseModel], loc: tuple[str | int, ...]) -> list[str]:
    """Names of the settings beside the one at `loc`: those of all, or of the block that it stands in."""
    for name in loc[:-1]:
        annotation = kind.model_fields[str(name)].annotation
        kind = next(t for t in (annotation, *get_args(annotation)) if isinstance(t, type))
    return sorted(kind.model_fields)
