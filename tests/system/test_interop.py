"""Descriptions of Xopt and Ax, read where they fit."""

from __future__ import annotations

import pytest

from hdsafebo import Choice, Fixed, Integer, Limit, Linear, Objective, Real
from hdsafebo.system.errors import DescriptionError
from hdsafebo.system.interop import from_ax, from_vocs

VOCS = {
    "variables": {"x1": [0, 3.1], "x2": [-1.0, 1.0]},
    "constraints": {"c1": ["GREATER_THAN", 0.0], "c2": ["LESS_THAN", 0.5]},
    "objectives": {"y1": "MINIMIZE"},
    "constants": {"a": "word"},
    "observables": [],
}
"""As `VOCS(...).model_dump()` of Xopt 2 has it."""
VOCS_3 = {
    "variables": {
        "x1": {"type": "ContinuousVariable", "domain": [0, 3.1], "default_value": None},
        "x2": {"type": "DiscreteVariable", "values": [1, 2, 5]},
    },
    "constraints": {
        "c1": {"type": "GreaterThanConstraint", "value": 0.0},
        "c2": {"type": "BoundsConstraint", "range": [0.1, 0.5]},
    },
    "objectives": {"y1": {"type": "MaximizeObjective"}},
    "constants": {"a": {"type": "Constant", "value": 2.0}},
}
AX = {
    "__type": "SearchSpace",
    "parameters": [
        {
            "__type": "RangeParameter",
            "name": "lr",
            "parameter_type": {"__type": "ParameterType", "name": "FLOAT"},
            "lower": 1e-4,
            "upper": 0.1,
            "log_scale": True,
            "digits": None,
            "is_fidelity": False,
        },
        {
            "__type": "RangeParameter",
            "name": "n",
            "parameter_type": {"__type": "ParameterType", "name": "INT"},
            "lower": 1,
            "upper": 9,
        },
        {"__type": "ChoiceParameter", "name": "c", "values": ["u", "v"], "is_ordered": True},
        {"__type": "FixedParameter", "name": "k", "value": 3},
    ],
    "parameter_constraints": [
        {"__type": "ParameterConstraint", "constraint_dict": {"lr": 10.0, "n": 1.0}, "bound": 8.0},
    ],
}
OBJECTIVE, LIMITS = Objective("y", "minimise"), [Limit("g", at_most=1.25)]


def test_vocs() -> None:
    system = from_vocs(VOCS)
    assert system.parameters == (Real("x1", 0, 3.1), Real("x2", -1.0, 1.0), Fixed("a", "word"))
    assert system.objective == Objective("y1", "minimise")
    assert system.limits == (Limit("c1", at_least=0.0), Limit("c2", at_most=0.5))
    newer = from_vocs(VOCS_3)
    assert newer.parameters == (Real("x1", 0, 3.1), Choice("x2", (1, 2, 5)), Fixed("a", 2.0))
    assert newer.objective.direction == "maximise"
    assert newer.limits == (Limit("c1", at_least=0.0), Limit("c2", at_least=0.1, at_most=0.5))


def test_ax() -> None:
    system = from_ax(AX, OBJECTIVE, LIMITS)
    assert system.parameters == (
        Real("lr", 1e-4, 0.1, log=True),
        Integer("n", 1, 9),
        Choice("c", ("u", "v"), ordered=True),
        Fixed("k", 3),
    )
    assert system.constraints == (Linear({"lr": 10.0, "n": 1.0}, at_most=8.0),)
    client = {
        "parameters": [
            {"name": "x1", "type": "range", "bounds": [0.0, 1.0], "value_type": "float"},
            {"name": "x2", "type": "range", "bounds": [1, 5], "value_type": "int"},
            {"name": "m", "type": "choice", "values": ["a", "b", "c"]},
        ],
        "parameter_constraints": ["x1 + x2 <= 5"],
    }
    system = from_ax(client, OBJECTIVE, LIMITS)
    assert system.parameters == (Real("x1", 0.0, 1.0), Integer("x2", 1, 5), Choice("m", ("a", "b", "c")))
    assert system.constraints == (Linear({"x1": 1.0, "x2": 1.0}, at_most=5.0),)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"objectives": {"y1": "MINIMIZE", "y2": "MINIMIZE"}}, "2 objectives"),
        ({"objectives": {"y1": "EXPLORE"}}, "'y1' is 'EXPLORE'"),
        ({"observables": ["z"]}, r"observables \['z'\]"),
        ({"variables": {"x1": 3}}, "variable 'x1' is 3"),
        ({"constraints": {"c1": ["EQUALS", 2]}}, "constraint 'c1' is"),
        ({"constraints": {}}, "has no limits"),
        ({"fidelities": [1]}, "VOCS has fidelities"),
    ],
)
def test_vocs_that_do_not_fit(change: dict, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        from_vocs(VOCS | change)


def test_ax_that_does_not_fit() -> None:
    fidelity = AX["parameters"][1] | {"is_fidelity": True}
    with pytest.raises(DescriptionError, match="'n' has is_fidelity"):
        from_ax({"parameters": [fidelity]}, OBJECTIVE, LIMITS)
    with pytest.raises(DescriptionError, match="of type 'derived'"):
        from_ax({"parameters": [{"name": "d", "type": "derived"}]}, OBJECTIVE, LIMITS)
