"""CPU time of rounds of `hdsafebo_local` on its inputs: growth with trials, dimensions and constraints.

Seconds of CPU per 10 trials, asked in batches of 5, as the median of several rounds after the known trials;
and the same in units of a yardstick, one Cholesky factorisation of 300 points measured beside, so that busy
and idle machines can be compared.

    python benchmarks/constrained_time.py --write
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from scipy.linalg import cho_factor

from hdsafebo import FunctionProblem, Safety, make_optimizer
from hdsafebo.typing import FloatArray

OUTPUT = Path(__file__).parents[1] / "reports" / "reference" / "benchmarks" / "constrained_time.json"
CENTRE = {"trials": 100, "dimension": 10, "constraints": 4}
AXES = {"trials": (50, 100, 200, 400), "dimension": (2, 5, 10, 20, 40, 80), "constraints": (1, 2, 4, 8, 16)}
BATCH = 5
YARD = 300


def problem(dimension: int, constraints: int) -> FunctionProblem:
    """A rippled bowl under half-spaces and a ball."""
    normals = np.random.default_rng(0).standard_normal((constraints, dimension))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)

    def function(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        offset = x - 0.5
        objective = -((offset - 0.2) ** 2).sum(axis=1) + 0.05 * np.sin(6 * x).sum(axis=1)
        return objective, 0.3 - offset @ normals.T + 0.1 * (offset**2).sum(axis=1, keepdims=True)

    bounds = [[0.0] * dimension, [1.0] * dimension]
    return FunctionProblem(function, bounds, [Safety(f"g{j}", 0.0) for j in range(constraints)])


def yardstick() -> float:
    """Seconds of CPU of one factorisation."""
    a = np.random.default_rng(0).random((YARD, YARD))
    a = a @ a.T + YARD * np.eye(YARD)
    before = time.process_time()
    for _ in range(20):
        cho_factor(a)
    return (time.process_time() - before) / 20


def measure(trials: int, dimension: int, constraints: int, rounds: int) -> dict[str, float | int]:
    """Rounds with so many known trials."""
    made = problem(dimension, constraints)
    optimizer = make_optimizer("hdsafebo_local", made, seed=0)
    x = np.random.default_rng(1).uniform(0.2, 0.8, (trials - BATCH, dimension))
    optimizer.observe(x, *made.function(x), initial=True)
    seconds, yards = [], []
    for _ in range(1 + rounds):
        before = time.process_time()
        asked = optimizer.ask(BATCH)
        optimizer.tell(asked, *made.function(asked.x))
        seconds.append(time.process_time() - before)
        yards.append(yardstick())
    per_ten = np.array(seconds[1:]) * 10 / BATCH  # the first round fits from nothing, and only probes
    return {
        "trials": trials,
        "dimension": dimension,
        "constraints": constraints,
        "cpu_s": float(np.median(per_ten)),
        "cpu_s_most": float(per_ten.max()),
        "first_s": float(seconds[0]),
        "yard_ms": float(1e3 * np.median(yards)),
        "yards": float(np.median(per_ten) / np.median(yards)),
    }


def main() -> None:
    """Along each axis, the others at the centre."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=6, help="measured per size (default: 6)")
    parser.add_argument("--write", action="store_true", help=f"keep the numbers in {OUTPUT.name}")
    arguments = parser.parse_args()
    sizes = [CENTRE | {axis: value} for axis, values in AXES.items() for value in values]
    rows = []
    for size in sizes:
        rows.append(measure(**size, rounds=arguments.rounds))
        print(" ".join(f"{key} {value:.4g}" for key, value in rows[-1].items()), flush=True)
    if arguments.write:
        OUTPUT.write_text(json.dumps(rows, indent=1, sort_keys=True) + "\n")


if __name__ == "__main__":
    main()
