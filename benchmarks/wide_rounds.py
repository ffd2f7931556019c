"""CPU time, memory and saved state of rounds of `hdsafebo_local` in tens of thousands of dimensions.

The problem is made of formulas: 64 linear features of the inputs decide, as on policies. Known trials are
drawn about the middle of the box, and rounds of ten are timed after the first, which fits from nothing.

    python benchmarks/wide_rounds.py --dimensions 63648 100000 --trials 300 1000
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import tempfile
import time
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import numpy as np  # noqa: E402  (after the thread limits)

from hdsafebo import HdSafeBOLocal, Safety  # noqa: E402
from hdsafebo.files.atomic import write_json  # noqa: E402
from hdsafebo.problem import FunctionProblem, LinearFeatures  # noqa: E402
from hdsafebo.typing import FloatArray  # noqa: E402

OUT = Path(__file__).parents[1] / "reports" / "reference" / "benchmarks" / "wide_rounds.json"
FEATURES = 64
INITIAL = 40
BATCH = 10
RESOLUTION = 2.0**-8
DEVIATION = 0.02
"""Of known trials from the middle of the box, whose sides are 2."""
_CHUNK = 50


def problem_of(dimension: int) -> FunctionProblem:
    """A bowl with ripples, safe where no feature is large."""
    matrix = np.random.default_rng(0).standard_normal((FEATURES, dimension)) / np.sqrt(dimension)

    def function(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        seen = x @ matrix.T
        value = -((seen - 0.3) ** 2).sum(axis=1) + np.sin(40 * seen).sum(axis=1) / 80
        return value, 1.0 - np.abs(seen).max(axis=1)

    box = np.stack([-np.ones(dimension), np.ones(dimension)])
    problem = FunctionProblem(function, box, [Safety("margin", 0.0)], "wide")
    problem.features = LinearFeatures(matrix)
    problem.resolution = np.full(dimension, RESOLUTION)
    problem.depends_on_history = False
    return problem


def measure(dimension: int, trials: int, rounds: int) -> dict[str, Any]:
    """Rounds of ten up to `trials` known trials, and the file of the state then."""
    problem, rng = problem_of(dimension), np.random.default_rng(1)
    optimizer = HdSafeBOLocal(problem, seed=0)
    known = trials - rounds * BATCH
    for first in range(0, known, _CHUNK):
        n = min(_CHUNK, known - first)
        x = DEVIATION * rng.standard_normal((n, dimension))
        x = np.clip(np.rint(x / RESOLUTION) * RESOLUTION, -1.0, 1.0)
        optimizer.observe(x, *problem.function(x), initial=first < INITIAL)
    seconds = []
    for _ in range(rounds):
        start = time.process_time()
        asked = optimizer.ask(BATCH)
        between = time.process_time()
        results = problem.function(asked.x)
        told = time.process_time()
        optimizer.tell(asked, *results)
        seconds.append(between - start + time.process_time() - told)
    with tempfile.TemporaryDirectory() as folder:
        start, path = time.process_time(), Path(folder) / "state"
        optimizer.save(path)
        saved, size = time.process_time() - start, path.stat().st_size
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {
        "dimension": dimension,
        "trials": trials,
        "round_cpu_s": float(np.median(seconds[1:])),
        "round_cpu_range_s": [float(min(seconds[1:])), float(max(seconds[1:]))],
        "first_round_cpu_s": seconds[0],
        "save_cpu_s": saved,
        "state_mb": size / 1e6,
        "peak_mb": peak / 1024,
    }


def main() -> None:
    """Measure each size in a process of its own, whose memory is then its own."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--dimensions", nargs="+", type=int, default=[63_648, 100_000])
    parser.add_argument("--trials", nargs="+", type=int, default=[300, 1000])
    parser.add_argument("--rounds", type=int, default=9, help="that are timed, the first apart (default: 9)")
    parser.add_argument("--write", action="store_true", help=f"keep the results in {OUT.name}")
    given = parser.parse_args()
    rows = []
    for dimension, trials in product(given.dimensions, given.trials):
        with get_context("spawn").Pool(1) as pool:
            rows.append(pool.apply(measure, (dimension, trials, given.rounds)))
        print(json.dumps(rows[-1]), flush=True)
    if given.write:
        write_json(OUT, rows)


if __name__ == "__main__":
    main()
