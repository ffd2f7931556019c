"""Time of one round (ask, and tell) of every method, split into fit, safe set and selection.

Each method runs in a process of its own, with one thread, on a smooth function with n evaluated points, half
of them spread over the box and half close to the best one, as in the middle of a run. Times are CPU times;
wall times, and the CPU time of a fixed factorisation between rounds, stand beside them: on a busy machine
both grow.

    python benchmarks/round_time.py --methods hdsafebo hdsafebo_local --sizes 500x50 1000x325
    python benchmarks/round_time.py --write
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import platform
import resource
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from pkgutil import resolve_name
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.linalg import cho_factor

from hdsafebo.files.atomic import write_json
from hdsafebo.optimizers.registry import METHODS, make_optimizer
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.typing import FloatArray

SIZES = ("500x50", "500x1000", "1000x325", "1000x16", "200x50", "300x50", "400x50", "200x1000", "350x1000")
"""Points by dimension: the latent space and the inputs of the synthetic task, and two larger problems."""
OUT = Path("reports/reference/benchmarks/round_time.json")
BATCH = 10
DISTINCT = list({(m.module, m.kind): name for name, m in reversed(METHODS.items())}.values())[::-1]
"""One name for each class; `random_lowest` needs a candidate set."""
DISTINCT.remove("random_lowest")
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
PHASES = {
    "fit": ("hdsafebo.optimizers.core.fits.fit_surrogate", "hdsafebo.gp.ard_process.WarmStart.process"),
    "safe_set": (
        "hdsafebo.gp.surrogate.Surrogate.believed_safe",
        "hdsafebo.gp.surrogate.Surrogate.predict_safety",
        "hdsafebo.gp.surrogate.Surrogate.slack_with_gradient",
    ),
}


class Waves:
    """Objective and safety as sums of plane waves, smooth over a third of the box."""

    def __init__(self, dimension: int) -> None:
        rng = np.random.default_rng(0)
        self.directions = rng.standard_normal((2, 200, dimension)) * 3.0 / np.sqrt(dimension)
        self.phases = rng.uniform(0, 2 * np.pi, (2, 200))

    def __call__(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Objective and safety, each of variance one."""
        values = [
            np.cos(x @ d.T + p).sum(axis=1) / 10.0 for d, p in zip(self.directions, self.phases, strict=True)
        ]
        return values[0], values[1]


class Stopwatch:
    """CPU time spent within functions, those called from one another counted once."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(PHASES, 0.0)
        self._depth = 0

    def timed(self, phase: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, with its time added to a phase."""

        def call(*args: Any, **kwargs: Any) -> Any:
            start = time.process_time()
            self._depth += 1
            try:
                return function(*args, **kwargs)
            finally:
                self._depth -= 1
                if self._depth == 0:
                    self.seconds[phase] += time.process_time() - start

        return call


def data(n: int, dimension: int, function: Waves) -> FloatArray:
    """(n, d) points: half uniform, half around the best safe one of these."""
    rng = np.random.default_rng(1)
    spread = rng.random((n - n // 2, dimension))
    objective, safety = function(spread)
    centre = spread[np.where(safety >= -0.75, objective, -np.inf).argmax()]
    close = centre + 0.03 * rng.standard_normal((n // 2, dimension))
    return np.vstack([spread, np.clip(close, 0.0, 1.0)])


def yardstick() -> float:
    """CPU seconds of a Cholesky factorisation of 1000 points, which a busy machine slows, too."""
    matrix = np.eye(1000) + np.full((1000, 1000), 0.5)
    start = time.process_time()
    cho_factor(matrix, lower=True, overwrite_a=True)
    return time.process_time() - start


def measure(method: str, n: int, dimension: int, rounds: int) -> dict[str, Any]:
    """Median times of `rounds` rounds after two that warm up; the last is asked with n points known."""
    function = Waves(dimension)
    bounds = np.stack([np.zeros(dimension), np.ones(dimension)])
    optimizer = make_optimizer(method, FunctionProblem(function, bounds, [Safety("safety", -0.75)]), seed=0)
    known = max(n - BATCH * (rounds + 1), 2)
    if getattr(optimizer, "uses_initial_data", True):
        x = data(known, dimension, function)
        optimizer.observe(x, *function(x), initial=True)
    else:
        design = optimizer.ask(known)
        optimizer.tell(design, *function(design.x))
    table: dict[str, list[float]] = {phase: [] for phase in ("total", "wall", *PHASES, "selection", "yard")}
    watch = Stopwatch()
    with ExitStack() as stack:
        for phase, targets in PHASES.items():
            for target in targets:
                owner, _, attribute = target.rpartition(".")
                original = getattr(resolve_name(owner), attribute)
                stack.enter_context(patch(target, watch.timed(phase, original)))
        for _ in range(rounds + 2):
            before, start, wall = dict(watch.seconds), time.process_time(), time.perf_counter()
            trials = optimizer.ask(BATCH)
            asked, wall_asked = time.process_time(), time.perf_counter()
            results = function(trials.x)
            told, wall_told = time.process_time(), time.perf_counter()
            optimizer.tell(trials, *results)
            total = asked - start + time.process_time() - told
            spent = {phase: watch.seconds[phase] - before[phase] for phase in PHASES}
            spent |= {"total": total, "selection": total - sum(spent.values()), "yard": yardstick()}
            spent["wall"] = wall_asked - wall + time.perf_counter() - wall_told
            for phase, seconds in spent.items():
                table[phase].append(seconds)
    kept = {phase: np.array(values[2:]) for phase, values in table.items()}
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "method": method,
        "n": n,
        "d": dimension,
        **{phase: float(np.median(values)) for phase, values in kept.items()},
        "total_min": float(kept["total"].min()),
        "total_max": float(kept["total"].max()),
        "peak_mb": peak,
        "rounds": rounds,
    }


def measure_all(method: str, sizes: list[str], rounds: int) -> None:
    """Print a line of JSON per size, each measured in a fork, so that peak memory is its own."""
    warnings.simplefilter("ignore")
    fork = multiprocessing.get_context("fork")

    def one(n: int, dimension: int) -> None:
        print(json.dumps(measure(method, n, dimension, rounds)), flush=True)

    for n, dimension in map(parse_size, sizes):
        process = fork.Process(target=one, args=(n, dimension))
        process.start()
        process.join()
        if process.exitcode:
            print(
                json.dumps({"method": method, "n": n, "d": dimension, "exit": process.exitcode}), flush=True
            )


def measured(method: str, sizes: list[str], rounds: int) -> Iterator[dict[str, Any]]:
    """The rows of a method as they come, from a process with one thread."""
    command = [sys.executable, __file__, "--rounds", str(rounds), "--sizes", *sizes, "--child", method]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | ONE_THREAD) as child:
        assert child.stdout is not None
        for line in child.stdout:
            yield json.loads(line)


def parse_size(size: str) -> tuple[int, int]:
    """Points and dimension of "500x50"."""
    n, dimension = size.split("x")
    return int(n), int(dimension)


def growth(rows: list[dict[str, Any]]) -> dict[str, float]:
    """By method, the power of n with which a round grows from the fewest to the most points at one d."""
    powers = {}
    for method in {row["method"] for row in rows}:
        totals = {row["n"]: row["total"] for row in rows if row["method"] == method and row["d"] == 50}
        if len(totals) > 1:
            low, high = min(totals), max(totals)
            powers[method] = round(float(np.log(totals[high] / totals[low]) / np.log(high / low)), 2)
    return dict(sorted(powers.items()))


def write(fresh: list[dict[str, Any]]) -> None:
    """Put rows in the place of earlier ones of the same method and size."""
    key = ("method", "n", "d")
    kept = json.loads(OUT.read_text(encoding="utf-8"))["rows"] if OUT.exists() else []
    rows = {tuple(row[k] for k in key): row for row in [*kept, *fresh]}
    ordered = [rows[k] for k in sorted(rows, key=lambda k: (k[2], k[1], k[0]))]
    machine = {"python": platform.python_version(), "numpy": np.__version__, "threads": 1, "batch": BATCH}
    content = {"machine": machine, "growth_in_n": growth(ordered), "rows": ordered}
    write_json(OUT, content)


def main() -> None:
    """Measure the methods that were asked for, one process each, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--methods", nargs="+", default=list(DISTINCT), metavar="NAME")
    parser.add_argument(
        "--sizes", nargs="+", default=list(SIZES), metavar="NxD", help=f"default: {' '.join(SIZES)}"
    )
    parser.add_argument(
        "--rounds", type=int, default=5, help="rounds measured per method and size (default: 5)"
    )
    parser.add_argument("--write", action="store_true", help=f"keep the numbers in {OUT}")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child is not None:
        measure_all(arguments.child, arguments.sizes, arguments.rounds)
        return
    columns = ("total", "total_min", "total_max", "wall", *PHASES, "selection", "yard", "peak_mb")
    print(f"{'method':16s} {'n':>5s} {'d':>4s} " + " ".join(f"{c:>9s}" for c in columns))
    for method in arguments.methods:
        for row in measured(method, arguments.sizes, arguments.rounds):
            head = f"{row['method']:16s} {row['n']:5d} {row['d']:4d} "
            if "exit" in row:
                print(head + f"ended with exit code {row['exit']}", flush=True)
                continue
            print(head + " ".join(f"{row[c]:9.3f}" for c in columns), flush=True)
            if arguments.write:
                write([row])


if __name__ == "__main__":
    main()
