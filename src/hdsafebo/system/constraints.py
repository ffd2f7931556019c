"""Linear constraints among parameters: known exactly, so that no trial ever violates one.

A point that violates one is projected onto the half-spaces in turn, rounded to what can be set, and, where
rounding undid that, drawn towards a setting that is known to meet all of them.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdsafebo.system.errors import DescriptionError, TableError
from hdsafebo.system.parameters import Real
from hdsafebo.system.values import Number, finite, plain, set_plain
from hdsafebo.typing import FloatArray

_MARGIN = 1e-9
"""Projected points keep so much from a constraint, in units of what the ranges can change it by: encoding and
decoding a value loses the last digits."""
_EQUAL = 1e-7
"""An equality is met when it is off by so much, in the same units."""
_SWEEPS = 200  # of projections onto one constraint after another, which converge geometrically
_DRAWS = 33  # shares of the line back to a point that meets all
_KINDS = {ast.LtE: "at_most", ast.Lt: "at_most", ast.GtE: "at_least", ast.Gt: "at_least", ast.Eq: "equals"}


@dataclass(frozen=True)
class Linear:
    """A weighted sum of real and integer parameters with a limit, in the parameters' own units.

    Attributes:
        coefficients: weight of each parameter, by name.
        at_most, at_least: limits of the sum; or
        equals: its value (parameters without steps only).
    """

    coefficients: dict[str, Number] = field(hash=False)
    at_most: Number | None = None
    at_least: Number | None = None
    equals: Number | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.coefficients, Mapping) or not self.coefficients:
            raise DescriptionError(
                f"a linear constraint has the coefficients {self.coefficients!r}; "
                "expected a weight for each parameter, such as {'a': 1, 'b': 2}"
            )
        weights = {n: plain(w, f"constraint: coefficient of {n!r}") for n, w in self.coefficients.items()}
        object.__setattr__(self, "coefficients", weights)
        for name, weight in self.coefficients.items():
            if finite(weight, f"constraint: coefficient of {name!r}") == 0:
                raise DescriptionError(f"constraint: coefficient of {name!r} is 0; leave the parameter out")
        given = [k for k in ("at_most", "at_least", "equals") if getattr(self, k) is not None]
        set_plain(self, f"constraint {self.left}", *given)
        if not given or ("equals" in given and len(given) > 1):
            raise DescriptionError(
                f"constraint {self.left} has {' and '.join(given) or 'no limit'}; expected at_most, "
                "at_least, both of these, or equals"
            )

    @classmethod
    def parse(cls, text: str) -> Linear:
        """From a text such as `2*a + b <= 4`; names that are no identifiers need the other form.

        Raises:
            DescriptionError: it is no comparison of linear sums.
        """
        try:
            tree = ast.parse(text.strip(), mode="eval").body
            if not isinstance(tree, ast.Compare) or len(tree.ops) != 1:
                raise ValueError("expected one of <=, >=, ==")
            kind = _KINDS[type(tree.ops[0])]
            left, right = _terms(tree.left), _terms(tree.comparators[0])
        except (SyntaxError, ValueError, KeyError, RecursionError, MemoryError, OverflowError) as error:
            reason = f" ({error})" if isinstance(error, ValueError) else ""
            raise DescriptionError(
                f"constraint {text!r} is not understood{reason}; expected a form such as '2*a + b <= 4'"
            ) from None
        total = {name: left.get(name, 0.0) - right.get(name, 0.0) for name in left | right}
        limit = -total.pop("", 0.0)
        return cls({name: weight for name, weight in total.items() if weight != 0}, **{kind: limit})

    @property
    def left(self) -> str:
        """Its weighted sum as text."""
        terms = [
            (f"{'-' if w < 0 else '+'} " + (name if abs(w) == 1 else f"{abs(w):g}*{name}"))
            for name, w in self.coefficients.items()
        ]
        return " ".join(terms).removeprefix("+ ")

    def __str__(self) -> str:
        if self.equals is not None:
            return f"{self.left} == {self.equals:g}"
        parts = [f"<= {self.at_most:g}"] if self.at_most is not None else []
        parts += [f">= {self.at_least:g}"] if self.at_least is not None else []
        return f"{self.left} {' and '.join(parts)}"


def _terms(node: ast.expr) -> dict[str, float]:
    """Coefficients of a linear sum; the constant under the empty name."""
    if isinstance(node, ast.Name):
        return {node.id: 1.0}
    if isinstance(node, ast.Constant):
        if isinstance(node.value, int | float) and not isinstance(node.value, bool):
            return {"": float(node.value)}
        raise ValueError(f"{node.value!r} is no number")
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        sign = -1.0 if isinstance(node.op, ast.USub) else 1.0
        return {name: sign * w for name, w in _terms(node.operand).items()}
    if isinstance(node, ast.BinOp):
        a, b = _terms(node.left), _terms(node.right)
        if isinstance(node.op, ast.Add | ast.Sub):
            sign = -1.0 if isinstance(node.op, ast.Sub) else 1.0
            return {name: a.get(name, 0.0) + sign * b.get(name, 0.0) for name in a | b}
        for factor, other in ((a, b), (b, a)):
            if isinstance(node.op, ast.Mult) and set(factor) == {""}:
                return {name: factor[""] * w for name, w in other.items()}
        if isinstance(node.op, ast.Div) and set(b) == {""} and b[""] != 0:
            return {name: w / b[""] for name, w in a.items()}
    raise ValueError(f"{ast.unparse(node)!r} is not linear")


class Feasible:
    """The settings that meet all constraints.

    Args:
        constraints: over the names of `parameters`.
        parameters: real and integer ones, in the order of the columns of values.

    Raises:
        DescriptionError: a constraint names something else, an equality has parameters with steps, or no
            setting meets all constraints.
    """

    def __init__(self, constraints: Sequence[Linear], parameters: Sequence[Real]) -> None:
        self.constraints = tuple(constraints)
        self.parameters = tuple(parameters)
        names = [p.name for p in parameters]
        self.lower = np.array([p.lower for p in parameters], float)
        self.upper = np.array([p.upper for p in parameters], float)
        self._stepped = np.array([p.spacing is not None for p in parameters], bool)
        self._log = np.array([p.log for p in parameters], bool)
        self._equal: list[bool] = []
        rows, limits, owners = [], [], []
        for number, constraint in enumerate(self.constraints):
            weights = np.zeros(len(names))
            for name, weight in constraint.coefficients.items():
                if name not in names:
                    raise DescriptionError(
                        f"constraint {constraint}: {name!r} is no real or integer parameter; these are "
                        f"{', '.join(names) or 'none'}"
                    )
                weights[names.index(name)] = weight
            if constraint.equals is not None and (self._stepped & (weights != 0)).any():
                raise DescriptionError(
                    f"constraint {constraint}: an equality cannot have parameters with steps; "
                    "give a list of the settings instead"
                )
            for sign, limit, equal in (
                (1.0, constraint.at_most, False),
                (-1.0, constraint.at_least, False),
                (1.0, constraint.equals, True),
            ):
                if limit is not None:
                    rows.append(sign * weights)
                    limits.append(sign * limit)
                    owners.append(number)
                    self._equal.append(equal)
        self._a = np.array(rows).reshape(len(rows), len(names))
        self._b = np.array(limits, float)
        self._owner = np.array(owners, int)
        self._scale = np.abs(self._a) @ (self.upper - self.lower)
        self.anchor = self._find_anchor() if rows else (self.lower + self.upper) / 2

    def met(self, values: FloatArray) -> NDArray[np.bool_]:
        """(n,) True for (n, k) values that meet every constraint, as they stand."""
        return np.asarray((self._excess(values) <= 0).all(axis=1))

    def check(self, values: FloatArray, error: type[TableError] = TableError) -> None:
        """Raise TableError that names the row, the constraint and its left side when one is not met."""
        excess = self._excess(values)
        for i, j in np.argwhere(excess > 0)[:1]:
            constraint = self.constraints[self._owner[j]]
            left = float(sum(w * values[i, self._names.index(n)] for n, w in constraint.coefficients.items()))
            raise error(f"row {i}: {constraint.left} is {left:.10g}; expected {constraint}")

    def land(self, values: FloatArray) -> FloatArray:
        """(n, k) values near the given ones that can be set and meet every constraint."""
        values = np.clip(values, self.lower, self.upper)
        if len(self._a) == 0:
            return self._rounded(values)
        landed = self._rounded(self._projected(values, np.zeros(len(self._stepped), bool)))
        wrong = ~self.met(landed)
        if wrong.any():
            landed[wrong] = self._rounded(self._projected(landed[wrong], self._stepped))
            wrong = ~self.met(landed)
        for share in np.linspace(1.0, 0.0, _DRAWS)[1:]:
            if not wrong.any():
                break
            drawn = self._rounded(self.anchor + share * (landed[wrong] - self.anchor))
            good = self.met(drawn)
            rows = np.flatnonzero(wrong)[good]
            landed[rows] = drawn[good]
            wrong[rows] = False
        return landed

    @property
    def _names(self) -> list[str]:
        return [p.name for p in self.parameters]

    def _excess(self, values: FloatArray) -> FloatArray:
        """(n, c) by how much each half-space is left, 0 or less within; equalities have their tolerance."""
        over = values @ self._a.T - self._b
        equal = np.array(self._equal, bool)
        over[:, equal] = np.abs(over[:, equal]) - _EQUAL * self._scale[equal]
        return over

    def _projected(self, values: FloatArray, held: NDArray[np.bool_]) -> FloatArray:
        """(n, k) values moved onto the half-spaces in turn, in units of the ranges; held columns stay.

        On a log scale a step is measured in ratios.
        """
        values = values.copy()
        width = np.broadcast_to(self.upper - self.lower, values.shape)
        for _ in range(_SWEEPS):
            moved = False
            for a, b, scale, equal in zip(self._a, self._b, self._scale, self._equal, strict=True):
                over = values @ a - b + (0.0 if equal else _MARGIN * scale)
                if not equal:
                    over = np.maximum(over, 0.0)
                if np.abs(over).max() <= 0.1 * _MARGIN * scale:
                    continue
                moved = True
                with np.errstate(divide="ignore", invalid="ignore"):
                    ratio = np.where(self._log, np.log(self.upper / np.abs(self.lower)), 1.0)
                weight = np.where(self._log, values * ratio, width) ** 2 * ~held
                pull = weight * a
                length = pull @ a
                share = np.divide(over, length, out=np.zeros(len(values)), where=length > 0)
                values = np.clip(values - share[:, None] * pull, self.lower, self.upper)
            if not moved:
                break
        return values

    def _rounded(self, values: FloatArray) -> FloatArray:
        columns = [p.land_values(values[:, j]) for j, p in enumerate(self.parameters)]
        return np.column_stack(columns) if columns else values

    def _find_anchor(self) -> FloatArray:
        """(k,) a setting that meets every constraint by as much as any does."""
        from scipy.optimize import Bounds, LinearConstraint, milp  # only systems with constraints wait for it

        k = len(self.parameters)
        spacing = np.array([p.spacing or 1.0 for p in self.parameters])
        offset = np.where(self._stepped, self.lower, 0.0)
        unit = np.where(self._stepped, spacing, 1.0)  # value = offset + unit * variable
        low, high = (self.lower - offset) / unit, (self.upper - offset) / unit
        high = np.where(self._stepped, np.floor(high + 1e-6), high)
        equal = np.array(self._equal, bool)
        rows = np.hstack([self._a * unit, np.where(equal, 0.0, self._scale)[:, None]])
        limits = self._b - self._a @ offset
        found = milp(
            np.r_[np.zeros(k), -1.0],
            constraints=LinearConstraint(rows, np.where(equal, limits, -np.inf), limits),
            bounds=Bounds(np.r_[low, 0.0], np.r_[high, 1.0]),
            integrality=np.r_[self._stepped.astype(int), 0],
        )
        if found.x is None:
            raise DescriptionError(
                f"no setting meets all of the constraints {'; '.join(map(str, self.constraints))}"
            )
        anchor = self._rounded(np.clip(offset + unit * found.x[:k], self.lower, self.upper)[None])
        if not self.met(anchor)[0]:
            anchor = self._rounded(self._projected(anchor, self._stepped))
        if not self.met(anchor)[0]:
            raise DescriptionError(
                f"the constraints {'; '.join(map(str, self.constraints))} leave no room beyond rounding"
            )
        return anchor[0]


def as_linear(constraint: Any) -> Linear:
    """A constraint given as `Linear` or as text."""
    if isinstance(constraint, Linear):
        return constraint
    if isinstance(constraint, str):
        return Linear.parse(constraint)
    raise DescriptionError(f"constraint {constraint!r}; expected a Linear or a text such as '2*a + b <= 4'")
