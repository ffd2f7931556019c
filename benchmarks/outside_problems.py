"""Constrained problems that others wrote, as `FunctionProblem`s: maximise f where every g is at least 0.

Seven are BoTorch's (`botorch.test_functions.synthetic`; its Ackley with the constraints of its SCBO
tutorial). Three are of the CEC 2006 collection (Liang et al., Problem definitions and evaluation criteria for
the CEC 2006 special session on constrained real-parameter optimization, 2006): g04, g07, g09. Two are seen
through noise, with a standard deviation of 1 % of each outcome's range over the box; they are scored without.

Each problem is searched over its own box, with its own units and BoTorch's own slacks; nothing is scaled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import qmc

from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.typing import FloatArray

Function = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
NOISE = 0.01
"""Standard deviation of the noise, in ranges of an outcome."""
NEAR = 0.05
STARTS = 5
"""Reach, in ranges, and number of initial inputs in one place."""
_RANGE_POINTS = 20_000
_DRAWS, _DRAWN = 400, 20_000


@dataclass(frozen=True)
class Outside:
    """A problem.

    Attributes:
        name: of the problem.
        true: (n,) objective and (n, m) slacks of (n, D) inputs, without noise.
        bounds: (2, D).
        optimum: best feasible objective, as published.
        trials: budget beside the initial data.
        noise: standard deviations of objective and slacks, (1 + m,); zeros without noise.
        violation_scale: (m,) median violation over the box, of points that violate.
    """

    name: str
    true: Function
    bounds: FloatArray
    optimum: float
    trials: int
    noise: FloatArray
    violation_scale: FloatArray

    def problem(self, seed: int) -> FunctionProblem:
        """The problem as methods see it; its noise follows from the seed and the order of evaluations."""
        rng = np.random.default_rng([seed, 77])

        def seen(x: FloatArray) -> tuple[FloatArray, FloatArray]:
            objective, slack = self.true(x)
            if not self.noise.any():
                return objective, slack
            drawn = rng.standard_normal((len(x), 1 + slack.shape[1])) * self.noise
            return objective + drawn[:, 0], slack + drawn[:, 1:]

        safety = [Safety(f"g{j + 1}", 0.0) for j in range(len(self.violation_scale))]
        return FunctionProblem(seen, self.bounds, safety, name=self.name)

    def initial(self, seed: int) -> FloatArray:
        """(n, D) inputs at the start: Sobol points, the last one replaced by a safe one if there is none."""
        d = self.bounds.shape[1]
        count = 40 if d >= 30 else max(10, 2 * d)
        unit = qmc.Sobol(d, scramble=True, rng=seed).random(1 << (count - 1).bit_length())[:count]
        x = self.bounds[0] + unit * (self.bounds[1] - self.bounds[0])
        if not (self.true(x)[1] >= 0).all(axis=1).any():
            x[-1] = self._safe_point(np.random.default_rng(10_000 + seed))
        return x

    def initial_in_one_place(self, seed: int) -> FloatArray:
        """(n, D) safe inputs, each within 5 % of the ranges of the first one.

        Raises:
            RuntimeError: too few are found.
        """
        rng = np.random.default_rng([seed, 78])
        reach = NEAR * (self.bounds[1] - self.bounds[0])
        first = self._safe_point(rng)
        x = first + reach * rng.uniform(-1.0, 1.0, (_DRAWN, len(first)))
        x = np.clip(np.vstack([first, x]), *self.bounds)
        safe = x[(self.true(x)[1] >= 0).all(axis=1)]
        if len(safe) < STARTS:
            raise RuntimeError(f"{self.name}: {len(safe)} of {_DRAWN} points around a safe one are safe")
        return safe[:STARTS]

    def _safe_point(self, rng: np.random.Generator) -> FloatArray:
        """(D,) the first safe one of uniform points.

        Raises:
            RuntimeError: none is found.
        """
        for _ in range(_DRAWS):
            x = rng.uniform(*self.bounds, (_DRAWN, self.bounds.shape[1]))
            safe = (self.true(x)[1] >= 0).all(axis=1)
            if safe.any():
                return np.asarray(x[safe][0])
        raise RuntimeError(f"{self.name}: none of {_DRAWS * _DRAWN} uniform points is safe")


def outside_problem(name: str) -> Outside:
    """The problem of a name of `NAMES`.

    Raises:
        KeyError: there is none.
    """
    base = name.removesuffix("_noisy")
    true, bounds, optimum, trials = _MAKERS[base]()
    limits = np.asarray(bounds, float).T
    x = np.random.default_rng(12_345).uniform(*limits, (_RANGE_POINTS, limits.shape[1]))
    objective, slack = true(x)
    outcomes = np.column_stack([objective, slack])
    noise = NOISE * np.ptp(outcomes, axis=0) if name.endswith("_noisy") else np.zeros(outcomes.shape[1])
    violated = [-column[column < 0] for column in slack.T]
    scale = np.array([np.median(v) if len(v) else 1.0 for v in violated])
    return Outside(name, true, limits, optimum, trials, noise, scale)


def _botorch(kind: str, optimum: float, trials: int = 100, **options: Any) -> Any:
    """A constrained function of BoTorch."""
    import torch
    from botorch.test_functions import synthetic

    function = getattr(synthetic, kind)(negate=True, **options)

    def true(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        with torch.no_grad():
            points = torch.from_numpy(np.asarray(x, float))
            return function(points, noise=False).numpy(), function.evaluate_slack_true(points).numpy()

    return true, function._bounds, optimum, trials


def _ackley() -> Any:
    """Ackley over [-5, 10]^10 with a sum of at most 0 and a norm of at most 5, as in the SCBO tutorial."""

    def true(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        mean_square, mean_cosine = (x * x).mean(axis=1), np.cos(2 * np.pi * x).mean(axis=1)
        value = -20 * np.exp(-0.2 * np.sqrt(mean_square)) - np.exp(mean_cosine) + 20 + np.e
        return -value, np.column_stack([-x.sum(axis=1), 5 - np.linalg.norm(x, axis=1)])

    return true, [(-5.0, 10.0)] * 10, 0.0, 100


def _g04() -> Any:
    def true(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        a, b, c, d, e = x.T
        f = 5.3578547 * c**2 + 0.8356891 * a * e + 37.293239 * a - 40792.141
        u = 85.334407 + 0.0056858 * b * e + 0.0006262 * a * d - 0.0022053 * c * e
        v = 80.51249 + 0.0071317 * b * e + 0.0029955 * a * b + 0.0021813 * c**2
        w = 9.300961 + 0.0047026 * c * e + 0.0012547 * a * c + 0.0019085 * c * d
        return -f, np.column_stack([92 - u, u, 110 - v, v - 90, 25 - w, w - 20])

    return true, [(78, 102), (33, 45), (27, 45), (27, 45), (27, 45)], 30665.539, 100


def _g07() -> Any:
    def true(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        a, b, c, d, e, f, g, h, i, j = x.T
        value = (
            a**2 + b**2 + a * b - 14 * a - 16 * b + (c - 10) ** 2 + 4 * (d - 5) ** 2 + (e - 3) ** 2
            + 2 * (f - 1) ** 2 + 5 * g**2 + 7 * (h - 11) ** 2 + 2 * (i - 10) ** 2 + (j - 7) ** 2 + 45
        )  # fmt: skip
        at_most_zero = [
            -105 + 4 * a + 5 * b - 3 * g + 9 * h,
            10 * a - 8 * b - 17 * g + 2 * h,
            -8 * a + 2 * b + 5 * i - 2 * j - 12,
            3 * (a - 2) ** 2 + 4 * (b - 3) ** 2 + 2 * c**2 - 7 * d - 120,
            5 * a**2 + 8 * b + (c - 6) ** 2 - 2 * d - 40,
            a**2 + 2 * (b - 2) ** 2 - 2 * a * b + 14 * e - 6 * f,
            0.5 * (a - 8) ** 2 + 2 * (b - 4) ** 2 + 3 * e**2 - f - 30,
            -3 * a + 6 * b + 12 * (i - 8) ** 2 - 7 * j,
        ]
        return -value, -np.column_stack(at_most_zero)

    return true, [(-10, 10)] * 10, -24.30621, 100


def _g09() -> Any:
    def true(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        a, b, c, d, e, f, g = x.T
        value = (
            (a - 10) ** 2 + 5 * (b - 12) ** 2 + c**4 + 3 * (d - 11) ** 2 + 10 * e**6 + 7 * f**2 + g**4
            - 4 * f * g - 10 * f - 8 * g
        )  # fmt: skip
        at_most_zero = [
            -127 + 2 * a**2 + 3 * b**4 + c + 4 * d**2 + 5 * e,
            -282 + 7 * a + 3 * b + 10 * c**2 + d - e,
            -196 + 23 * a + b**2 + 6 * f**2 - 8 * g,
            4 * a**2 + b**2 - 3 * a * b + 2 * c**2 + 5 * f - 11 * g,
        ]
        return -value, -np.column_stack(at_most_zero)

    return true, [(-10, 10)] * 7, -680.63006, 100


_MAKERS: dict[str, Callable[[], Any]] = {
    "pressure": lambda: _botorch("PressureVessel", -5634.0),
    "speed": lambda: _botorch("SpeedReducer", -2996.348),
    "welded": lambda: _botorch("WeldedBeamSO", -1.5868),
    "tension": lambda: _botorch("TensionCompressionString", -0.0126652),
    "hartmann6": lambda: _botorch("ConstrainedHartmann", 3.32237, dim=6),
    "ackley10": _ackley,
    "keane30": lambda: _botorch("KeaneBumpFunction", 0.8183, trials=150, dim=30),
    "gramacy": lambda: _botorch("ConstrainedGramacy", -0.5998),
    "g04": _g04,
    "g07": _g07,
    "g09": _g09,
}
DEVELOPED = ("pressure", "speed", "welded", "tension", "hartmann6", "ackley10", "keane30")
"""The local method's constants were chosen on these, seeds 0 to 2 and 10 to 14."""
NAMES = (*DEVELOPED, "hartmann6_noisy", "gramacy_noisy", "g04", "g07", "g09")
