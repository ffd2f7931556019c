"""Baselines on the problems of BoTorch's tutorials, beside the values that the tutorials print.

    python benchmarks/baseline_references.py --seeds 5
    python benchmarks/baseline_references.py --only scbo --seeds 5 --tutorial --write

Same problems, batch sizes, numbers of initial Sobol points and stopping points as the tutorials "Scalable
Constrained Bayesian Optimization (SCBO)", "BO with TuRBO-1 and TS/qEI" and "BO with BAxUS and TS/EI"
(https://botorch.org/docs/tutorials). A tutorial shows one run; a run here ends where the tutorial's
ended. With `--tutorial` the tutorial's own loop of SCBO runs, too, from the same initial points: at the same
number of evaluations, and at the point where a region first collapses, which is where that loop ends. Times
are CPU times of this process with one thread per numerical library.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scbo_tutorial import tutorial_run
from scipy.stats import mannwhitneyu, qmc
from threadpoolctl import threadpool_limits

from hdsafebo.files.atomic import write_json
from hdsafebo.optimizers.registry import make_optimizer
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.typing import FloatArray

OUT = Path("reports/reference/benchmarks/baseline_references.json")
MOST = 300
"""Evaluations after which a region that has not collapsed is left alone."""


def ackley(x: FloatArray) -> FloatArray:
    """(n,) negative Ackley function; its maximum is 0 at 0."""
    wave = np.exp(np.cos(2 * np.pi * x).mean(axis=1))
    return np.asarray(20 * np.exp(-0.2 * np.sqrt((x * x).mean(axis=1))) + wave - 20 - np.e)


def branin(u: FloatArray) -> FloatArray:
    """(n,) negative Branin function of the first two of many inputs in [-1, 1]; its maximum is -0.397887."""
    a, b = 7.5 * u[:, 0] + 2.5, 7.5 * u[:, 1] + 7.5
    valley = (b - 5.1 / (4 * np.pi**2) * a * a + 5 / np.pi * a - 6) ** 2
    return -(valley + 10 * (1 - 1 / (8 * np.pi)) * np.cos(a) + 10)


def box(low: float, high: float, dimension: int) -> FloatArray:
    """(2, d) limits."""
    return np.stack([np.full(dimension, low), np.full(dimension, high)])


def constrained_ackley(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ackley function with sum(x) <= 0 and |x| <= 5."""
    return ackley(x), np.column_stack([-x.sum(axis=1), 5.0 - np.linalg.norm(x, axis=1)])


def without_constraint(function: Callable[[FloatArray], FloatArray]) -> Callable[[FloatArray], Any]:
    """The function with a safety value that is always met."""
    return lambda x: (function(x), np.ones((len(x), 1)))


@dataclass(frozen=True)
class Case:
    """One tutorial.

    Attributes:
        method: name of ours.
        problem: what it optimises.
        settings: of the method.
        initial: Sobol points at the start.
        batch: points per round.
        trials: evaluations at which the tutorial's run ended.
        value: best (feasible) value that the tutorial prints there.
    """

    method: str
    problem: FunctionProblem
    settings: dict[str, Any]
    initial: int
    batch: int
    trials: int
    value: float


CASES = (
    Case(
        "scbo",
        FunctionProblem(
            constrained_ackley,
            box(-5, 10, 10),
            [Safety("sum", 0.0), Safety("norm", 0.0)],
            "ackley10_constrained",
        ),
        {"candidates": 2000},
        initial=10,
        batch=4,
        trials=190,
        value=-0.324,
    ),
    Case(
        "turbo",
        FunctionProblem(without_constraint(ackley), box(-5, 10, 20), name="ackley20"),
        {},
        initial=40,
        batch=4,
        trials=396,
        value=-1.15,
    ),
    Case(
        "baxus",
        FunctionProblem(without_constraint(branin), box(-1, 1, 500), name="branin500"),
        {"budget": 500},
        initial=10,
        batch=1,
        trials=110,
        value=-0.398,
    ),
)


@dataclass(frozen=True)
class Run:
    """One run; values are the best feasible ones, None without any.

    Attributes:
        seed: of initial points and method.
        value: at the tutorial's number of evaluations.
        collapse: evaluations when the region first collapsed; None if it did not.
        at_collapse: value there.
        cpu_seconds: of the whole run.
    """

    seed: int
    value: float | None
    collapse: int | None
    at_collapse: float | None
    cpu_seconds: float


def initial_points(case: Case, seed: int) -> FloatArray:
    """Sobol points of the unit cube."""
    sobol = qmc.Sobol(case.problem.bounds.shape[1], rng=seed)
    return np.asarray(sobol.random_base2(int(np.ceil(np.log2(case.initial))))[: case.initial])


def scaled(case: Case, unit: FloatArray) -> FloatArray:
    """Points of the unit cube as inputs."""
    lower, upper = case.problem.bounds
    return np.asarray(lower + unit * (upper - lower))


def best_feasible(objective: FloatArray, margins: FloatArray, first: int | None = None) -> float | None:
    """Highest objective of the first points whose every margin is at least 0."""
    feasible = objective[:first][(margins[:first] >= 0).all(axis=1)]
    return float(feasible.max()) if len(feasible) else None


def run(case: Case, seed: int, to_collapse: bool) -> Run:
    """One run of ours; to the collapse of the region if that is later."""
    optimizer = make_optimizer(case.method, case.problem, seed=seed, **case.settings)
    started, collapse = time.process_time(), None
    if getattr(optimizer, "uses_initial_data", True):
        x = scaled(case, initial_points(case, seed))
        optimizer.observe(x, *case.problem.function(x), initial=True)
    while len(optimizer.trials) < case.trials or (
        to_collapse and collapse is None and len(optimizer.trials) < MOST
    ):
        trials = optimizer.ask(case.initial if len(optimizer.trials) == 0 else case.batch)
        optimizer.tell(trials, *case.problem.function(trials.x))
        if collapse is None and optimizer.method_state()[0].get("since", 0) > 0:
            collapse = len(optimizer.trials)
    done = optimizer.trials
    margins = done.safety - np.array([s.threshold for s in case.problem.safety])
    return Run(
        seed,
        best_feasible(done.objective, margins, case.trials),
        collapse,
        None if collapse is None else best_feasible(done.objective, margins, collapse),
        time.process_time() - started,
    )


def run_tutorial(case: Case, seed: int) -> Run:
    """One run of the tutorial's loop; it ends when the region collapses."""
    started = time.process_time()
    objective, margins = tutorial_run(
        lambda unit: case.problem.function(scaled(case, unit)),
        initial_points(case, seed),
        case.batch,
        MOST,
        seed,
    )
    return Run(
        seed,
        best_feasible(objective, margins, case.trials),
        len(objective) if len(objective) < MOST else None,
        best_feasible(objective, margins) if len(objective) < MOST else None,
        time.process_time() - started,
    )


def summary(label: str, case: Case, runs: list[Run]) -> dict[str, Any]:
    """One row of the table, and what the file keeps."""
    values = np.array([np.nan if run.value is None else run.value for run in runs])
    ends = np.array([np.nan if run.at_collapse is None else run.at_collapse for run in runs])
    return {
        "method": label,
        "problem": case.problem.name,
        "trials": case.trials,
        "printed": case.value,
        "median": float(np.median(values)),
        "best": float(values.max()),
        "worst": float(values.min()),
        "collapsed": float(np.median(ends[np.isfinite(ends)])) if np.isfinite(ends).any() else None,
        "cpu_seconds": float(np.median([run.cpu_seconds for run in runs])),
        "runs": [asdict(run) for run in runs],
    }


def main() -> None:
    """Run the cases, print the table, and write it if asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=5, help="runs per case (default 5)")
    parser.add_argument("--only", choices=[case.method for case in CASES], help="one case only")
    parser.add_argument("--tutorial", action="store_true", help="run the tutorial's loop of SCBO, too")
    parser.add_argument("--write", action="store_true", help=f"put the numbers into {OUT}")
    arguments = parser.parse_args()
    rows: list[dict[str, Any]] = []
    heads = ("trials", "printed", "median", "best", "worst", "collapsed", "cpu_seconds")
    print(f"{'method':15}{'problem':21}" + "".join(f"{head:>12}" for head in heads))
    with threadpool_limits(1):
        for case in CASES:
            if arguments.only not in (None, case.method):
                continue
            both = arguments.tutorial and case.method == "scbo"
            kinds: dict[str, Callable[[int], Run]] = {
                case.method: lambda seed, case=case, both=both: run(case, seed, both)
            }
            if both:
                kinds["scbo_tutorial"] = lambda seed, case=case: run_tutorial(case, seed)
            for label, one in kinds.items():
                row = summary(label, case, [one(seed) for seed in range(arguments.seeds)])
                rows.append(row)
                numbers = "".join(f"{'-':>12}" if row[h] is None else f"{row[h]:12.3f}" for h in heads)
                print(f"{label:15}{case.problem.name:21}{numbers}", flush=True)
            if both:
                ours, theirs = (
                    [np.inf if r["value"] is None else -r["value"] for r in row["runs"]] for row in rows[-2:]
                )
                rows[-1]["p_value"] = float(mannwhitneyu(ours, theirs).pvalue)
                print(f"ours against the tutorial's loop: p = {rows[-1]['p_value']:.2f} (Mann-Whitney)")
    if arguments.write:
        kept = json.loads(OUT.read_text(encoding="utf-8")) if OUT.exists() else []
        fresh = {row["method"] for row in rows}
        rows = [row for row in kept if row["method"] not in fresh] + rows
        write_json(OUT, rows)
        print(f"wrote {OUT}")


if __name__ == "__main__":
    main()
