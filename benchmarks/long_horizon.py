"""Ten thousand trials with a surrogate of bounded cost, and what bounding it costs.

First a run of `hdsafebo_local` with `max_fitted_trials` on a smooth function, each round journalled as in
the pipeline: the CPU time of a round (ask, tell and journal) near 1,000 trials against that near the end.
Then the same method with and without the bound on the same problems and budget, as far as the exact process
can go.

    python benchmarks/long_horizon.py --write
"""

from __future__ import annotations

import argparse
import json
import platform
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hdsafebo.campaign.rounds import Round, RunJournal, points_digest
from hdsafebo.files.atomic import write_json
from hdsafebo.optimizers.registry import make_optimizer
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.runs.write import rows_of
from hdsafebo.typing import FloatArray

OUTPUT = Path(__file__).parents[1] / "reports" / "reference" / "benchmarks" / "long_horizon.json"
METHOD = "hdsafebo_local"
DIMENSION = 20
INITIAL = 200
BATCH = 10
THRESHOLD = -0.75
WAVES = 200
LENGTH = 0.35
"""Length scale of the waves, in widths of the box times the square root of its dimension."""
PARTS = ("long_run", "comparison")
AROUND = 20
"""Rounds whose median is the time at a number of trials."""


class Waves:
    """Objective and safety, independent sums of plane waves of variance one (samples of a smooth process)."""

    def __init__(self, seed: int, dimension: int = DIMENSION) -> None:
        rng = np.random.default_rng(seed)
        self.directions = rng.standard_normal((2, WAVES, dimension)) / (LENGTH * np.sqrt(dimension))
        self.phases = rng.uniform(0, 2 * np.pi, (2, WAVES))

    def __call__(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Objective and safety."""
        values = [
            np.sqrt(2 / WAVES) * np.cos(x @ d.T + p).sum(axis=1)
            for d, p in zip(self.directions, self.phases, strict=True)
        ]
        return values[0], values[1]


@dataclass(frozen=True)
class Run:
    """One run: what it reached, and the CPU seconds of each round after `trials` were known."""

    objective: float
    safety: float
    trials: list[int]
    seconds: list[float]

    def seconds_near(self, trials: int) -> float:
        """Median seconds of the rounds nearest to a number of trials."""
        nearest = np.argsort(np.abs(np.array(self.trials) - trials), kind="stable")[:AROUND]
        return float(np.median(np.array(self.seconds)[nearest]))


def run(seed: int, trials: int, most: int | None) -> Run:
    """One run to the given number of trials; `most` is `max_fitted_trials`."""
    function = Waves(seed)
    bounds = np.stack([np.zeros(DIMENSION), np.ones(DIMENSION)])
    problem = FunctionProblem(function, bounds, [Safety("safety", THRESHOLD)], name="waves")
    optimizer = make_optimizer(METHOD, problem, seed=seed, max_fitted_trials=most)
    x = np.random.default_rng([seed, 1]).random((INITIAL, DIMENSION))
    optimizer.observe(x, *function(x), initial=True)
    known, seconds = [], []
    with tempfile.TemporaryDirectory() as directory, RunJournal(Path(directory), "long", {}) as journal:
        while len(optimizer.trials) < trials:
            known.append(len(optimizer.trials))
            start = time.process_time()
            asked = optimizer.ask(min(BATCH, trials - len(optimizer.trials)))
            evaluating = time.process_time()
            told = asked.with_results(problem.evaluate(asked))
            evaluated = time.process_time()
            optimizer.tell(told, told.objective, told.safety)
            rows = rows_of(told, problem, seed=seed, method_seconds=0.0, evaluate_seconds=0.0)
            journal.append(Round(points_digest(asked), rows))
            seconds.append(evaluating - start + time.process_time() - evaluated)
    best = optimizer.best()
    chosen = optimizer.feasible[INITIAL:]
    return Run(np.nan if best is None else float(best.objective), float(chosen.mean()), known, seconds)


def long_run(seed: int, trials: int, most: int, early: int) -> dict[str, Any]:
    """Times of a long run, early and at the end."""
    result = run(seed, trials, most)
    marks = sorted({early, *range(early, trials, max(early, 1)), trials})
    times = {str(n): result.seconds_near(n) for n in marks}
    return {
        "seed": seed,
        "trials": trials,
        "max_fitted_trials": most,
        "objective": result.objective,
        "safety": result.safety,
        "seconds_per_round": times,
        "ratio": times[str(trials)] / times[str(early)],
        "cpu_seconds": sum(result.seconds),
    }


def compare(seeds: list[int], trials: int, most: int) -> dict[str, Any]:
    """The bounded surrogate against the exact one on the same problems."""
    table: dict[str, list[dict[str, float]]] = {"bounded": [], "exact": []}
    for seed in seeds:
        for name, bound in (("bounded", most), ("exact", None)):
            result = run(seed, trials, bound)
            row = {
                "seed": seed,
                "objective": result.objective,
                "safety": result.safety,
                "seconds_per_round_at_end": result.seconds_near(trials),
                "cpu_seconds": sum(result.seconds),
            }
            table[name].append(row)
            print(f"{name:8s} {json.dumps(row)}", flush=True)
    pairs = zip(table["bounded"], table["exact"], strict=True)
    differences = np.array([bounded["objective"] - exact["objective"] for bounded, exact in pairs])
    return {
        "trials": trials,
        "max_fitted_trials": most,
        **table,
        "objective_difference": float(differences.mean()),
        "objective_difference_se": float(differences.std(ddof=1) / np.sqrt(len(differences))),
    }


def main() -> None:
    """Both parts, printed, and written when asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--part", nargs="+", choices=PARTS, default=list(PARTS), help="default: both")
    parser.add_argument("--most", type=int, default=200, help="max_fitted_trials (default: 200)")
    parser.add_argument("--trials", type=int, default=10_000, help="of the long run (default: 10000)")
    parser.add_argument("--early", type=int, default=1_000, help="of the first timing (default: 1000)")
    parser.add_argument("--compared", type=int, default=600, help="in the comparison (default: 600)")
    parser.add_argument(
        "--seeds",
        type=int,
        nargs="+",
        default=list(range(1000, 1010)),
        help="of the comparison, the first that of the long run (default: 1000 to 1009)",
    )
    parser.add_argument("--write", action="store_true", help=f"write {OUTPUT.name} with the other benchmarks")
    arguments = parser.parse_args()
    result: dict[str, Any] = {"method": METHOD, "dimension": DIMENSION, "batch": BATCH, "initial": INITIAL}
    result["machine"] = {"python": platform.python_version(), "processor": platform.machine(), "threads": 1}
    if "long_run" in arguments.part:
        seed = arguments.seeds[0]
        result["long_run"] = long_run(seed, arguments.trials, arguments.most, arguments.early)
        print(json.dumps(result["long_run"]), flush=True)
    if "comparison" in arguments.part:
        result["comparison"] = compare(arguments.seeds, arguments.compared, arguments.most)
    if arguments.write:
        OUTPUT.parent.mkdir(parents=True, exist_ok=True)
        kept = json.loads(OUTPUT.read_text()) if OUTPUT.exists() else {}
        write_json(OUTPUT, kept | result, sort_keys=True)


if __name__ == "__main__":
    main()
