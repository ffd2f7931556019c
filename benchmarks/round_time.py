"""Time of one round (ask, and tell) of every method, split into fit, safe set and selection.

Each method runs in a process of its own, with one thread, on a smooth function with n evaluated points, half
of them spread over the box and half close to the best one, as in the middle of a run. Times are CPU times.

    python benchmarks/round_time.py --methods hdsafebo hdsafebo_local --sizes 500x50 1000x325
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from hdsafebo.optimizers.registry import METHODS, make_optimizer
from hdsafebo.problem import FloatArray, FunctionProblem, Safety

SIZES = ("200x50", "300x50", "400x50", "500x50", "1000x50", "1000x325", "1000x16")
BATCH = 10
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
PHASES = {
    "fit": ("hdsafebo.optimizers.base.fit_surrogate", "hdsafebo.optimizers.ard_process.WarmStart.process"),
    "safe_set": (
        "hdsafebo.surrogate.Surrogate.believed_safe",
        "hdsafebo.surrogate.Surrogate.predict_safety",
        "hdsafebo.surrogate.Surrogate.slack_with_gradient",
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


def measure(method: str, n: int, dimension: int, rounds: int) -> dict[str, Any]:
    """Median times of `rounds` rounds after two that warm up; the last is asked with n points known."""
    function = Waves(dimension)
    bounds = np.stack([np.zeros(dimension), np.ones(dimension)])
    optimizer = make_optimizer(method, FunctionProblem(function, bounds, [Safety("safety", -0.75)]), seed=0)
    x = data(max(n - BATCH * (rounds + 1), 2), dimension, function)
    optimizer.observe(x, *function(x), initial=True)
    table: dict[str, list[float]] = {phase: [] for phase in ("total", *PHASES, "selection")}
    watch = Stopwatch()
    with ExitStack() as stack:
        for phase, targets in PHASES.items():
            for target in targets:
                owner, _, attribute = target.rpartition(".")
                original = getattr(_resolve(owner), attribute)
                stack.enter_context(patch(target, watch.timed(phase, original)))
        for _ in range(rounds + 2):
            before, start = dict(watch.seconds), time.process_time()
            trials = optimizer.ask(BATCH)
            asked = time.process_time()
            results = function(trials.x)
            told = time.process_time()
            optimizer.tell(trials, *results)
            total = asked - start + time.process_time() - told
            spent = {phase: watch.seconds[phase] - before[phase] for phase in PHASES}
            for phase, seconds in (
                spent | {"total": total, "selection": total - sum(spent.values())}
            ).items():
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
    }


def _resolve(path: str) -> Any:
    """The module or class of a dotted path."""
    from pkgutil import resolve_name

    return resolve_name(path)


def run_child(method: str, n: str, dimension: str, rounds: int, timeout: float) -> dict[str, Any] | str:
    """Measure in a process of its own; a text says why there is no result."""
    command = [sys.executable, __file__, "--rounds", str(rounds), "--child", method, n, dimension]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=timeout, check=True, env=os.environ | ONE_THREAD
        )
    except subprocess.TimeoutExpired:
        return f"no result within {timeout:.0f} s"
    except subprocess.CalledProcessError as error:
        return error.stderr.strip().splitlines()[-1][:90]
    row: dict[str, Any] = json.loads(done.stdout)
    return row


def main() -> None:
    """Measure the methods that were asked for, one process each, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--methods", nargs="+", default=[m for m in METHODS if "_beta" not in m], metavar="NAME"
    )
    parser.add_argument(
        "--sizes", nargs="+", default=list(SIZES), metavar="NxD", help=f"default: {' '.join(SIZES)}"
    )
    parser.add_argument(
        "--rounds", type=int, default=5, help="rounds measured per method and size (default: 5)"
    )
    parser.add_argument(
        "--timeout", type=float, default=600.0, help="seconds per method and size (default: 600)"
    )
    parser.add_argument("--json", type=Path, default=None, help="write the numbers here, too")
    parser.add_argument("--child", nargs=3, default=None, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child is not None:
        method, n, dimension = arguments.child
        warnings.simplefilter("ignore")
        print(json.dumps(measure(method, int(n), int(dimension), arguments.rounds)))
        return
    columns = ("total", "total_min", "total_max", *PHASES, "selection", "peak_mb")
    print(f"{'method':24s} {'n':>5s} {'d':>4s} " + " ".join(f"{c:>9s}" for c in columns))
    rows = []
    for size in arguments.sizes:
        n, dimension = size.split("x")
        for method in arguments.methods:
            row = run_child(method, n, dimension, arguments.rounds, arguments.timeout)
            if isinstance(row, str):
                print(f"{method:24s} {n:>5s} {dimension:>4s} {row}", flush=True)
            else:
                rows.append(row)
                numbers = " ".join(f"{row[c]:9.3f}" for c in columns)
                print(f"{method:24s} {n:>5s} {dimension:>4s} {numbers}", flush=True)
    if arguments.json is not None:
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        machine = {"python": platform.python_version(), "processor": platform.processor(), "threads": 1}
        arguments.json.write_text(json.dumps({"machine": machine, "rounds": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
