"""Data that are hard for a Gaussian process: inputs and outcomes at the limits of floating point."""

from __future__ import annotations

import numpy as np

from hdsafebo.typing import FloatArray

INPUTS = ("plain", "repeated", "constant", "cluster", "scaled", "outlier", "condition", "offset", "rank one")
OUTCOMES = ("plain", "equal", "outlier", "scaled", "offset", "binary", "heavy tails", "largest")


def hard_inputs(rng: np.random.Generator, n: int, p: int, kind: str) -> FloatArray:
    """(n, p) inputs."""
    x = rng.random((n, p))
    if kind == "repeated":
        return x[rng.integers(max(1, n // 5), size=n)]
    if kind == "constant":
        x[:, rng.random(p) < 0.7] = 0.3
    elif kind == "cluster":
        x = x[[0]] + 10.0 ** rng.uniform(-16, -4) * x
    elif kind == "scaled":
        x = x * 10.0 ** rng.uniform(-20, 100)
    elif kind == "outlier":
        x[rng.integers(n)] = 1e12
    elif kind == "condition":
        x = x * 10.0 ** rng.uniform(-16, 0, p)
    elif kind == "offset":
        x = x + 10.0 ** rng.uniform(0, 12)
    elif kind == "rank one":
        x = x[:, :1] * np.linspace(0, 1, p)
    return x


def hard_outcomes(rng: np.random.Generator, x: FloatArray, kind: str) -> FloatArray:
    """(n,) outcomes at the (n, p) inputs, all finite."""
    n = len(x)
    spread = np.ptp(x, axis=0)
    unit = (x - x.min(axis=0)) / np.where(spread > 0, spread, 1.0)
    y = np.asarray(np.sin(3 * unit).sum(axis=1)) + 0.01 * rng.standard_normal(n)
    if kind == "equal":
        y[:] = 2.0
    elif kind == "outlier":
        y[rng.integers(n)] = rng.choice([-1, 1]) * 1e12
    elif kind == "scaled":
        y = y * 10.0 ** rng.uniform(-150, 150)
    elif kind == "offset":
        y = y + 10.0 ** rng.uniform(0, 14)
    elif kind == "binary":
        y = rng.choice([0.0, 1.0], n)
    elif kind == "heavy tails":
        y = rng.standard_cauchy(n) ** 3
    elif kind == "largest":
        y[rng.integers(n)] = rng.choice([-1, 1]) * 10.0 ** rng.uniform(12, 307)
    return y
