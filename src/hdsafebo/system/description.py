"""`System`: what is optimised, in the user's own words; to and from YAML and JSON."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from hdsafebo.files.bounded import read_bounded
from hdsafebo.system.constraints import Feasible, Linear, as_linear
from hdsafebo.system.errors import DescriptionError
from hdsafebo.system.outcomes import Limit, Objective
from hdsafebo.system.parameters import Choice, Fixed, Integer, Parameter, Real
from hdsafebo.system.values import check_distinct, check_name

if TYPE_CHECKING:
    pass

NOISE, DEVIATION, SAFE = "_noise", "_sd", "_safe"
"""Endings of the columns with known noise, with the deviation of a belief, and with its safe probability."""
_COLUMNS = ("trial", "status", "safe", "initial", "round", "safe_probability", "marked_unsafe")
"""Columns that a study's tables have beside the system's."""
_COMPLETES = f"completes{SAFE}"
_MAX_BYTES = 2**26
Failures = Literal["unsafe", "ignored"]


@dataclass(frozen=True)
class System:
    """A system to optimise.

    Attributes:
        name: of the system, for messages and files.
        parameters: what is chosen, or fixed; at least one can vary.
        objective: what is optimised.
        limits: what must stay within limits, at least one.
        contexts: known before each trial and not chosen (a load, a day, a state); given with each `ask`.
        constraints: linear ones among parameters, `Linear` or texts such as "2*a + b <= 4".
        settings: a table of the only settings that can be tried, one column per parameter (a DataFrame, or
            lists by name); None means every point of the ranges.
        failures: "unsafe" learns from failed trials where trials fail and keeps away; "ignored" does not.

    Raises:
        DescriptionError: something is missing or contradicts itself; the message names it.
    """

    name: str
    parameters: tuple[Parameter, ...]
    objective: Objective
    limits: tuple[Limit, ...]
    contexts: tuple[Parameter, ...] = ()
    constraints: tuple[Linear, ...] = ()
    settings: dict[str, list[Any]] | None = field(default=None, repr=False)
    failures: Failures = "unsafe"

    def __post_init__(self) -> None:
        check_name(self.name, "the system")
        for key, kind in (("parameters", Parameter), ("contexts", Parameter), ("limits", Limit)):
            values = getattr(self, key)
            values = (values,) if isinstance(values, kind) else tuple(values)
            for value in values:
                if not isinstance(value, kind):
                    raise DescriptionError(f"{key} hold {value!r}; expected {_named(kind)}")
            object.__setattr__(self, key, values)
        object.__setattr__(self, "constraints", tuple(map(as_linear, self.constraints)))
        if not isinstance(self.objective, Objective):
            raise DescriptionError(f"objective is {self.objective!r}; expected an Objective")
        if not self.limits:
            raise DescriptionError(f"system {self.name!r} has no limits; expected at least one Limit")
        if not any(p.width for p in self.parameters):
            raise DescriptionError(f"system {self.name!r} has no parameter that can vary")
        if any(isinstance(c, Fixed) for c in self.contexts):
            raise DescriptionError("a context cannot be Fixed; put the value among the parameters")
        check_distinct(
            [*self.inputs, self.objective.name, *(limit.name for limit in self.limits)],
            "parameters, contexts, objective and limits",
        )
        self._require_own_columns()
        if self.failures not in ("unsafe", "ignored"):
            raise DescriptionError(f"failures is {self.failures!r}; expected 'unsafe' or 'ignored'")
        if self.settings is not None:
            object.__setattr__(self, "settings", _columns(self.settings, self.inputs, self.contexts))
            if self.constraints:
                raise DescriptionError(
                    "a list of settings cannot have constraints as well; leave the rows out that violate them"
                )
        self.feasible  # noqa: B018 (constraints that cannot be met are found now)

    def _require_own_columns(self) -> None:
        """Raise DescriptionError for a name under which tables show something else."""
        told = [*self.inputs, *self.outcomes, *(f"{name}{NOISE}" for name in self.outcomes), *_COLUMNS]
        believed = [*self.outcomes, *(f"{name}{DEVIATION}" for name in self.outcomes), _COMPLETES]
        believed += [f"{limit.name}{SAFE}" for limit in self.limits]
        for columns in (told, believed):
            for name in columns:
                if columns.count(name) > 1:
                    raise DescriptionError(
                        f"two columns of a study's tables would be called {name!r}; expected other names of "
                        "parameters, contexts, objective and limits"
                    )

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of parameters and contexts, in the order of the columns of tables."""
        return tuple(p.name for p in (*self.parameters, *self.contexts))

    @property
    def outcomes(self) -> tuple[str, ...]:
        """Names of what is measured: the objective, then the limits."""
        return (self.objective.name, *(limit.name for limit in self.limits))

    @cached_property
    def feasible(self) -> Feasible:
        """The settings that meet the linear constraints."""
        return Feasible(self.constraints, [p for p in self.parameters if isinstance(p, Real)])

    # --- files

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], source: str = "description") -> System:
        """The system that `to_dict` wrote, or one written by hand.

        Raises:
            DescriptionError: a key is missing, unknown, of the wrong type or out of range.
        """
        if not isinstance(data, Mapping):
            raise DescriptionError(f"{source}: expected a mapping of keys to values")
        try:
            plain = _ADAPTER.validate_python(dict(data))
            return plain.system()
        except ValidationError as error:
            raise DescriptionError("\n".join(f"{source}: {_explain(e)}" for e in error.errors())) from None
        except DescriptionError as error:
            raise DescriptionError(f"{source}: {error}") from None

    def to_dict(self) -> dict[str, Any]:
        """Plain data, without what has its default."""
        data: dict[str, Any] = {
            "name": self.name,
            "parameters": [_plain(p) for p in self.parameters],
            "objective": _plain(self.objective),
            "limits": [_plain(limit) for limit in self.limits],
        }
        if self.contexts:
            data["contexts"] = [_plain(p) for p in self.contexts]
        if self.constraints:
            data["constraints"] = [_plain(c) for c in self.constraints]
        if self.settings is not None:
            data["settings"] = self.settings
        if self.failures != "unsafe":
            data["failures"] = self.failures
        return data

    @classmethod
    def load(cls, path: str | Path) -> System:
        """From a YAML or JSON file; `settings` may be the name of a CSV file beside it.

        Raises:
            DescriptionError: the file cannot be read, or is no description; the message names file and key.
        """
        from hdsafebo.files.yaml import read_mapping

        path = Path(path)
        data = read_json(path) if path.suffix == ".json" else read_mapping(path, DescriptionError)
        if isinstance(data.get("settings"), str):
            data["settings"] = read_settings(path.parent / data["settings"])
        return cls.from_dict(data, source=str(path))

    def save(self, path: str | Path) -> None:
        """To a YAML file, or to JSON where the name ends in .json.

        Raises:
            WriteError: the file cannot be written.
        """
        from hdsafebo.files.atomic import WriteError, write_json
        from hdsafebo.files.yaml import write_mapping

        path = Path(path)
        if path.suffix == ".json":
            write_json(path, self.to_dict())
        else:
            write_mapping(path, self.to_dict(), WriteError)


@dataclass(frozen=True)
class _Description:
    """What a file may hold."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    name: str
    parameters: list[Annotated[Real | Integer | Choice | Fixed, Field(discriminator="kind")]]
    objective: Objective
    limits: list[Limit]
    contexts: list[Annotated[Real | Integer | Choice | Fixed, Field(discriminator="kind")]] = field(
        default_factory=list
    )
    constraints: list[str | Linear] = field(default_factory=list)
    settings: dict[str, list[Any]] | None = None
    failures: Failures = "unsafe"

    def system(self) -> System:
        return System(
            self.name,
            tuple(self.parameters),
            self.objective,
            tuple(self.limits),
            tuple(self.contexts),
            tuple(self.constraints),  # type: ignore[arg-type]
            self.settings,
            self.failures,
        )


_PARTS: tuple[Any, ...] = (Real, Integer, Choice, Fixed, Objective, Limit, Linear)
for _part in _PARTS:
    _part.__pydantic_config__ = ConfigDict(extra="forbid")
_ADAPTER: TypeAdapter[_Description] = TypeAdapter(_Description)


def read_settings(path: Path) -> dict[str, list[Any]]:
    """Columns of a CSV file.

    Raises:
        DescriptionError: it cannot be read.
    """
    import pandas as pd

    try:
        with warnings.catch_warnings():
            # Of rows longer than the header, pandas would take the first value for a label, or drop the last.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            content = BytesIO(read_bounded(path, _MAX_BYTES, DescriptionError))
            # Of texts only an empty one is missing: "NA" and "None" may be choices.
            table = pd.read_csv(content, index_col=False, keep_default_na=False, na_values=[""])
    except (ValueError, pd.errors.ParserWarning) as error:
        raise DescriptionError(f"{path}: cannot be read: {error}") from None
    return {str(name): table[name].tolist() for name in table.columns}


def read_json(path: Path) -> dict[str, Any]:
    """The object that a JSON file holds.

    Raises:
        DescriptionError: the file is missing, too large, no JSON or no object.
    """
    try:
        text = read_bounded(path, _MAX_BYTES, DescriptionError).decode("utf-8-sig")
        data = json.loads(text, object_pairs_hook=_each_once)
    except (ValueError, RecursionError) as error:
        raise DescriptionError(f"{path}: cannot be read as JSON: {error}") from None
    if not isinstance(data, dict):
        raise DescriptionError(f"{path}: expected an object of keys and values")
    return data


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of JSON, of which Python would keep the last of two values under one key."""
    data: dict[str, Any] = {}
    for key, value in pairs:
        if key in data:
            raise ValueError(f"the key {key!r} appears twice")
        data[key] = value
    return data


def _columns(table: Any, inputs: Sequence[str], contexts: Sequence[Parameter]) -> dict[str, list[Any]]:
    """Lists by name, of equal length and with the right names."""
    columns = {str(name): list(values) for name, values in dict(table).items()}
    known = {c.name for c in contexts}
    given = sorted(known & set(columns))
    if given:
        raise DescriptionError(
            f"settings have the column {given[0]!r}, which is a context: it is told with "
            "each ask; leave the column out"
        )
    wanted = [name for name in inputs if name not in known]
    missing, more = sorted(set(wanted) - set(columns)), sorted(set(columns) - set(wanted))
    if missing or more:
        raise DescriptionError(
            f"settings have the columns {', '.join(columns) or 'none'}; expected {', '.join(wanted)}"
        )
    lengths = {len(values) for values in columns.values()}
    if len(lengths) != 1 or lengths == {0}:
        raise DescriptionError(
            f"settings have columns of {sorted(lengths)} rows; expected one length above 0"
        )
    return {n: [v.item() if hasattr(v, "item") else v for v in columns[n]] for n in wanted}


def _plain(part: Any) -> dict[str, Any]:
    """A part of a description without what has its default."""
    defaults = {f.name: f.default for f in part.__dataclass_fields__.values()}
    keep = {k: v for k, v in asdict(part).items() if k == "kind" or v != defaults[k]}
    return {k: list(v) if isinstance(v, tuple) else v for k, v in keep.items()}


def _named(kind: Any) -> str:
    return "Real, Integer, Choice or Fixed" if kind is Parameter else f"a {kind.__name__}"


def _explain(error: Any) -> str:
    """One line of a pydantic error: key, what is wrong, the value."""
    key = ".".join(str(part) for part in error["loc"]) or "(top level)"
    message = error["msg"].removeprefix("Value error, ")
    if error["type"] in ("unexpected_keyword_argument", "extra_forbidden"):
        return f"{key}: unknown key"
    if error["type"] in ("missing", "missing_argument"):
        return f"{key}: is missing and has no default"
    value = repr(error["input"])
    return f"{key}: {message}, got {value if len(value) <= 80 else value[:77] + '...'}"
