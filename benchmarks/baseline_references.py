"""Baselines on the problems of BoTorch's tutorials, beside the values that the tutorials print.

    python benchmarks/baseline_references.py --seeds 5
    python benchmarks/baseline_references.py --only scbo --seeds 3 --json

Same problems, batch sizes, numbers of initial Sobol points and stopping points as the tutorials "Scalable
Constrained Bayesian Optimization (SCBO)", "BO with TuRBO-1 and TS/qEI" and "BO with BAxUS and TS/EI"
(https://botorch.org/docs/tutorials). A tutorial shows one run; a run here ends where the tutorial's
ended. Times are CPU times of this process with one thread per numerical library.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from hdsafebo.optimizers.registry import make_optimizer
from hdsafebo.problem import FloatArray, FunctionProblem, Safety
from hdsafebo.progress import track

OUT = Path("reports/benchmarks/baseline_references.json")


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


def run(case: Case, seed: int) -> tuple[float, float]:
    """Best feasible value (NaN without one) and CPU seconds of one run."""
    optimizer = make_optimizer(case.method, case.problem, seed=seed, **case.settings)
    started = time.process_time()
    if getattr(optimizer, "uses_initial_data", True):
        sobol = qmc.Sobol(case.problem.bounds.shape[1], rng=seed)
        unit = sobol.random_base2(int(np.ceil(np.log2(case.initial))))[: case.initial]
        x = case.problem.bounds[0] + unit * (case.problem.bounds[1] - case.problem.bounds[0])
        optimizer.observe(x, *case.problem.function(x), initial=True)
    while len(optimizer.trials) < case.trials:
        first = len(optimizer.trials) == 0
        trials = optimizer.ask(
            case.initial if first else min(case.batch, case.trials - len(optimizer.trials))
        )
        optimizer.tell(trials, *case.problem.function(trials.x))
    best = optimizer.best()
    return (np.nan if best is None else float(best.objective[0])), time.process_time() - started


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=5, help="runs per case (default 5)")
    parser.add_argument("--only", choices=[case.method for case in CASES], help="one case only")
    parser.add_argument("--json", action="store_true", help=f"write {OUT}")
    arguments = parser.parse_args()
    cases = [case for case in CASES if arguments.only in (None, case.method)]
    jobs = [(case, seed) for case in cases for seed in range(arguments.seeds)]
    results: dict[str, list[tuple[float, float]]] = {case.method: [] for case in cases}
    with threadpool_limits(1):
        for case, seed in track(jobs, "reference runs"):
            results[case.method].append(run(case, seed))
    rows = []
    heads = ("trials", "tutorial", "median", "best", "worst", "CPU s")
    print(f"{'method':8}{'problem':22}" + "".join(f"{head:>9}" for head in heads))
    for case in cases:
        values, seconds = np.array(results[case.method]).T
        rows.append(
            {
                "method": case.method,
                "problem": case.problem.name,
                "trials": case.trials,
                "tutorial": case.value,
                "values": values.tolist(),
                "median": float(np.median(values)),
                "best": float(values.max()),
                "worst": float(values.min()),
                "cpu_seconds": float(np.median(seconds)),
            }
        )
        numbers = [rows[-1][key] for key in ("tutorial", "median", "best", "worst", "cpu_seconds")]
        print(
            f"{case.method:8}{case.problem.name:22}{case.trials:9d}" + "".join(f"{n:9.3f}" for n in numbers)
        )
    if arguments.json:
        OUT.parent.mkdir(parents=True, exist_ok=True)
        OUT.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
        print(f"wrote {OUT}")


if __name__ == "__main__":
    main()
