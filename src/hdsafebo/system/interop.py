"""Descriptions of other libraries, where they fit: Xopt's VOCS, and Ax's search space as JSON.

What a description here cannot say (several objectives, fidelities, dependent parameters) is refused by name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hdsafebo.system.constraints import Linear
from hdsafebo.system.description import System
from hdsafebo.system.errors import DescriptionError
from hdsafebo.system.outcomes import Limit, Objective
from hdsafebo.system.parameters import Choice, Fixed, Integer, Parameter, Real

_DIRECTIONS = {"MINIMIZE": "minimise", "MAXIMIZE": "maximise"}
_SIDES = {"GREATER_THAN": "at_least", "LESS_THAN": "at_most"}


def from_vocs(vocs: Mapping[str, Any], name: str = "vocs") -> System:
    """The system of an Xopt VOCS, as its `model_dump()` or YAML gives it.

    Args:
        vocs: with the keys variables, objectives, constraints, constants.
        name: of the system.

    Raises:
        DescriptionError: something has no counterpart here; the message names it.
    """
    _known(vocs, ("variables", "objectives", "constraints", "constants", "observables"), "VOCS")
    if vocs.get("observables"):
        raise DescriptionError(
            f"VOCS: observables {sorted(vocs['observables'])} are neither "
            "optimised nor limited; leave them out"
        )
    objectives = dict(vocs.get("objectives") or {})
    if len(objectives) != 1:
        raise DescriptionError(f"VOCS: {len(objectives)} objectives {sorted(objectives)}; expected one")
    ((objective, direction),) = objectives.items()
    direction = direction.get("type", "") if isinstance(direction, Mapping) else direction
    sense = _DIRECTIONS.get(str(direction).upper().removesuffix("OBJECTIVE"))
    if sense is None:
        raise DescriptionError(
            f"VOCS: objective {objective!r} is {direction!r}; expected MINIMIZE or MAXIMIZE"
        )
    parameters = [_variable(n, v) for n, v in dict(vocs.get("variables") or {}).items()]
    for constant, value in dict(vocs.get("constants") or {}).items():
        parameters.append(Fixed(constant, value["value"] if isinstance(value, Mapping) else value))
    limits = [_limit(n, c) for n, c in dict(vocs.get("constraints") or {}).items()]
    return System(name, tuple(parameters), Objective(objective, sense), tuple(limits))  # type: ignore[arg-type]


def _variable(name: str, given: Any) -> Parameter:
    if isinstance(given, Mapping):
        if "values" in given:
            return Choice(name, tuple(given["values"]))
        given = given.get("domain")
    if isinstance(given, set | frozenset):
        return Choice(name, tuple(sorted(given)))
    if not isinstance(given, Sequence) or isinstance(given, str) or len(given) != 2:
        raise DescriptionError(f"VOCS: variable {name!r} is {given!r}; expected [lower, upper]")
    return Real(name, given[0], given[1])


def _limit(name: str, given: Any) -> Limit:
    if isinstance(given, Mapping):
        kind = str(given.get("type", "")).removesuffix("Constraint")
        if kind == "Bounds":
            low, high = given["range"]
            return Limit(name, at_least=low, at_most=high)
        given = [{"GreaterThan": "GREATER_THAN", "LessThan": "LESS_THAN"}.get(kind), given.get("value")]
    side = _SIDES.get(str(given[0]).upper()) if isinstance(given, Sequence) and len(given) == 2 else None
    if side is None:
        raise DescriptionError(
            f"VOCS: constraint {name!r} is {given!r}; expected [GREATER_THAN or LESS_THAN, value]"
        )
    return Limit(name, **{side: given[1]})


def from_ax(
    space: Mapping[str, Any], objective: Objective, limits: Sequence[Limit], name: str = "ax"
) -> System:
    """The system of an Ax search space, in Ax's JSON form or in the form that `AxClient` is given.

    Args:
        space: with the keys parameters and parameter_constraints.
        objective: what is optimised.
        limits: what must stay within limits.
        name: of the system.

    Raises:
        DescriptionError: something has no counterpart here; the message names it.
    """
    _known(space, ("__type", "parameters", "parameter_constraints"), "search space")
    parameters = [_ax_parameter(p) for p in space.get("parameters") or ()]
    constraints = [_ax_constraint(c) for c in space.get("parameter_constraints") or ()]
    return System(name, tuple(parameters), objective, tuple(limits), constraints=tuple(constraints))


def _ax_parameter(given: Mapping[str, Any]) -> Parameter:
    name = str(given.get("name"))
    kind = str(given.get("__type") or given.get("type", "")).removesuffix("Parameter").lower()
    for key in ("is_fidelity", "is_hierarchical", "dependents", "is_task"):
        if given.get(key):
            raise DescriptionError(f"parameter {name!r} has {key}, which has no counterpart here")
    value_type = given.get("parameter_type") or given.get("value_type") or "FLOAT"
    value_type = str(value_type["name"] if isinstance(value_type, Mapping) else value_type).upper()
    if kind == "range":
        low, high = given["bounds"] if "bounds" in given else (given["lower"], given["upper"])
        log, step = bool(given.get("log_scale")), given.get("step_size")
        if value_type == "INT":
            return Integer(name, low, high, log=log, step=step)
        if given.get("digits") is not None and step is None:
            step = 10.0 ** -int(given["digits"])
        return Real(name, low, high, log=log, step=step)
    if kind == "choice":
        values = tuple(given["values"])
        return (
            Choice(name, values, ordered=bool(given.get("is_ordered")))
            if len(values) > 1
            else Fixed(name, values[0])
        )
    if kind == "fixed":
        return Fixed(name, given["value"])
    raise DescriptionError(f"parameter {name!r} is of type {kind!r}; expected range, choice or fixed")


def _ax_constraint(given: Any) -> Linear:
    if isinstance(given, str):
        return Linear.parse(given)
    if "inequality" in given:
        return Linear.parse(given["inequality"])
    kind = given.get("__type")
    if kind == "ParameterConstraint":
        return Linear(dict(given["constraint_dict"]), at_most=given["bound"])
    if kind == "SumConstraint":
        weights = dict.fromkeys(map(str, given["parameter_names"]), 1.0)
        side = "at_most" if given.get("is_upper_bound", True) else "at_least"
        return Linear(weights, **{side: abs(given["bound"])})
    if kind == "OrderConstraint":
        return Linear({given["lower_name"]: 1.0, given["upper_name"]: -1.0}, at_most=0.0)
    raise DescriptionError(f"parameter constraint {given!r} has no counterpart here")


def _known(data: Mapping[str, Any], keys: Sequence[str], what: str) -> None:
    if not isinstance(data, Mapping):
        raise DescriptionError(f"{what} is {type(data).__name__}; expected a mapping")
    unknown = sorted(str(k) for k in set(data) - set(keys) if data[k])
    if unknown:
        raise DescriptionError(f"{what} has {', '.join(unknown)}; expected {', '.join(keys)}")
