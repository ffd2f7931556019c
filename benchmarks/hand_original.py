"""Every method on the hand in the space of all policy parameters: that it runs, what it costs, what it finds.

One seed, the same initial policies for all methods that can start from given ones. Each method runs in a
process of its own with one thread; times are CPU seconds, those of the physics apart. The times of a round
belong to the last rounds, so to nearly all trials.

    python benchmarks/hand_original.py --methods hdsafebo hdsafebo_local
    python benchmarks/hand_original.py --write
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import platform
import resource
import time
import warnings
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import numpy as np  # noqa: E402  (after the thread limits)

from hdsafebo.errors import NoSafePointError, SurrogateError  # noqa: E402
from hdsafebo.files.atomic import write_json  # noqa: E402
from hdsafebo.optimizers.base import Optimizer  # noqa: E402
from hdsafebo.optimizers.registry import METHODS, make_optimizer  # noqa: E402
from hdsafebo.params import load_params  # noqa: E402
from hdsafebo.problem import Problem  # noqa: E402
from hdsafebo.problems.registry import make_task  # noqa: E402
from hdsafebo.trials import Trials  # noqa: E402

ROOT = Path(__file__).parents[1]
OUT = ROOT / "reports" / "reference" / "benchmarks" / "hand_original.json"
DISTINCT = list({(m.module, m.kind): name for name, m in reversed(METHODS.items())}.values())[::-1]
"""One name for each class; `random_lowest` needs a candidate set."""
DISTINCT.remove("random_lowest")
INITIAL = 200
BATCH = 10
SEED = 1000
LAST = 5


class Clock:
    """The problem's evaluations, and the CPU time that they and the method take."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.physics = 0.0

    def evaluate(self, trials: Trials) -> Trials:
        """The trials with their results."""
        start = time.process_time()
        told = trials.with_results(self.problem.evaluate(trials))
        self.physics += time.process_time() - start
        return told


def settings_of(method: str) -> dict[str, Any]:
    """Settings that the parameters give the method where it searches the original space."""
    blocks = load_params(ROOT / "params.yaml").methods.values()
    return next((b.settings for b in blocks if (b.algorithm, b.space) == (method, "original")), {})


def play(method: str, problem: Problem, initial: Trials, trials: int) -> dict[str, Any]:
    """Results, times and peak memory of one run."""
    warnings.simplefilter("ignore")
    optimizer: Optimizer = make_optimizer(method, problem, seed=SEED, **settings_of(method))
    clock, seconds, stopped = Clock(problem), [], ""
    if optimizer.uses_initial_data:
        optimizer.observe(initial.x, initial.objective, initial.safety, status=initial.status, initial=True)
    else:
        told = clock.evaluate(optimizer.ask(INITIAL))
        optimizer.tell(told, told.objective, told.safety, status=told.status)
    while len(optimizer.trials) < trials:
        start = time.process_time() - clock.physics
        try:
            told = clock.evaluate(optimizer.ask(min(BATCH, trials - len(optimizer.trials))))
        except (NoSafePointError, SurrogateError) as error:
            stopped = str(error)
            break
        optimizer.tell(told, told.objective, told.safety, status=told.status)
        seconds.append(time.process_time() - clock.physics - start)
    best = optimizer.best()
    safe = optimizer.feasible[INITIAL:]
    return {
        "method": method,
        "trials": len(optimizer.trials),
        "dimension": optimizer.space.dimension,
        "round_s": float(np.median(seconds[-LAST:])) if seconds else None,
        "round_worst_s": max(seconds, default=None),
        "method_s": sum(seconds),
        "physics_s": clock.physics,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "safety": float(safe.mean()) if len(safe) else None,
        "best_initial": float(initial.objective[_feasible(problem, initial)].max(initial=-np.inf)),
        "best": None if best is None else float(best.objective),
        "abstained": stopped,
    }


def _feasible(problem: Problem, trials: Trials) -> np.ndarray:
    thresholds = np.array([s.threshold for s in problem.safety])
    binding = np.array([s.modelled or s.reported for s in problem.safety])
    return np.asarray((trials.safety >= thresholds)[:, binding].all(axis=1) & trials.completed)


def in_own_process(*arguments: Any) -> dict[str, Any]:
    """What `play` gives, from a fork, so that peak memory is the method's own (and the physics')."""
    fork = multiprocessing.get_context("fork")
    ours, theirs = fork.Pipe(duplex=False)

    def child(answer: Connection) -> None:
        answer.send(play(*arguments))

    process = fork.Process(target=child, args=(theirs,))
    process.start()
    theirs.close()
    try:
        return dict(ours.recv())
    except EOFError:
        process.join()
        return {"method": arguments[0], "exit": process.exitcode}


def initial_policies() -> tuple[Problem, Trials]:
    """The task in its informed setting, and its initial policies with their results."""
    task = make_task("hand_informed", load_params(ROOT / "params.yaml"), seed=SEED, root=ROOT)
    x, candidate = task.problem.initial(INITIAL, np.random.default_rng(SEED))
    trials = Trials.pending(x, x, len(task.problem.safety), candidate=candidate)
    return task.problem, trials.with_results(task.problem.evaluate(trials))


def main() -> None:
    """Run the methods one after the other and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--methods", nargs="+", default=list(DISTINCT), metavar="NAME")
    parser.add_argument(
        "--trials", type=int, default=300, help=f"{INITIAL} initial ones included (default: 300)"
    )
    parser.add_argument("--write", action="store_true", help=f"keep the numbers in {OUT.relative_to(ROOT)}")
    arguments = parser.parse_args()
    met = initial_policies()
    columns = ("round_s", "round_worst_s", "peak_mb", "safety", "best_initial", "best")
    print(f"{'method':26s}" + "".join(f"{c:>14s}" for c in columns), flush=True)
    rows = {}
    for method in arguments.methods:
        row = rows[method] = in_own_process(method, *met, arguments.trials)
        if "exit" in row:
            print(f"{method:26s} ended with exit code {row['exit']}", flush=True)
            continue
        shown = "".join(f"{'-' if row[c] is None else format(row[c], '.3f'):>14s}" for c in columns)
        print(f"{method:26s}{shown}  {row['abstained']}", flush=True)
        if arguments.write:
            write(list(rows.values()))


def write(rows: list[dict[str, Any]]) -> None:
    """Put rows in the place of earlier ones of the same method."""
    kept = json.loads(OUT.read_text(encoding="utf-8"))["rows"] if OUT.exists() else []
    merged = {row["method"]: row for row in [*kept, *rows]}
    machine = {"python": platform.python_version(), "numpy": np.__version__, "threads": 1, "batch": BATCH}
    content = {"machine": machine, "initial": INITIAL, "seed": SEED, "rows": list(merged.values())}
    write_json(OUT, content)


if __name__ == "__main__":
    main()
