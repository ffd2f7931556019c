"""Small systems for tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from hdsafebo import Choice, Fixed, Integer, Limit, Objective, Real, Study, System


def mixed_system(**changes: Any) -> System:
    """Every kind of part: minimised, one upper and one two-sided limit, a context, two linear constraints."""
    parts: dict[str, Any] = {
        "name": "mixed",
        "parameters": [
            Real("frequency", 1, 100, unit="Hz", log=True),
            Real("angle", -30, 30, step=0.5),
            Integer("pulses", 1, 8),
            Choice("pad", ["soft", "ribbed", "hard"]),
            Fixed("gap", 3),
        ],
        "objective": Objective("error", "minimise"),
        "limits": [Limit("heat", at_most=60, unit="C"), Limit("grip", at_least=2, at_most=50)],
        "contexts": [Real("load", 0, 5, unit="kg")],
        "constraints": ["3*pulses + angle <= 40"],
    }
    return System(**(parts | changes))


def box_system(**changes: Any) -> System:
    """Two real parameters and one limit."""
    parts: dict[str, Any] = {
        "name": "box",
        "parameters": [Real("a", 0, 10), Real("b", 0, 10)],
        "objective": Objective("gain"),
        "limits": [Limit("load", at_most=12)],
    }
    return System(**(parts | changes))


def run_box(setting: dict[str, Any]) -> dict[str, float]:
    """Best at (7, 7), where the load is too high."""
    a, b = setting["a"], setting["b"]
    return {"gain": -((a - 7) ** 2) - (b - 7) ** 2, "load": a + b}


def run_mixed(setting: dict[str, Any], context: dict[str, Any]) -> dict[str, float]:
    """An optimum at 20 Hz, 5 degrees, 5 pulses, ribbed."""
    f, angle, pulses = np.log(setting["frequency"]), setting["angle"], setting["pulses"]
    error = (f - 3) ** 2 + (angle - 5) ** 2 / 200 + 0.3 * abs(pulses - 5)
    return {
        "error": error + {"soft": 1.0, "ribbed": 0.0, "hard": 0.5}[setting["pad"]],
        "heat": 20 + 6 * f + 2 * pulses + 3 * context["load"],
        "grip": 10 - context["load"],
    }


def box_study(n: int = 8, seed: int = 0, **settings: Any) -> Study:
    """A study of the box with careful trials."""
    study = Study(box_system(), seed=seed, **({"alpha": 0.95} | settings))
    study.observe(box_starts(n, seed))
    return study


def box_starts(n: int = 8, seed: int = 0) -> list[dict[str, float]]:
    """Careful trials of the box."""
    settings = [
        {"a": float(a), "b": float(b)} for a, b in np.random.default_rng(seed).uniform(0.5, 4.5, (n, 2))
    ]
    return [s | run_box(s) for s in settings]


def mixed_starts(n: int = 20, seed: int = 0, load: float = 1.0) -> list[dict[str, Any]]:
    """Careful trials of the mixed system, all with one load."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(n):
        setting = {
            "frequency": float(np.exp(rng.uniform(0.2, 1.5))),
            "angle": float(rng.integers(-40, 10)) / 2,
            "pulses": int(rng.integers(1, 5)),
            "pad": str(rng.choice(["soft", "ribbed", "hard"])),
        }
        rows.append(setting | {"load": load} | run_mixed(setting, {"load": load}))
    return rows
