"""Problems that others wrote (see `outside_problems`), by the public interface with every method's defaults.

Every method marks what it does not believe safe, where it would otherwise abstain, so that runs are of equal
length. It gets the same initial data and is asked for batches of 5, 100 trials in all (150 in 30
dimensions). A trial is safe when its true slacks are at least 0. What is recorded of a run:

    best         best true objective of the safe trials, initial ones included, after every batch
    safe         share of the asked trials that were safe
    violation    mean over asked trials of the sum of violations, in medians of the box's violating points
    near         share of asked trials within 1e-3 of the cube's side of an earlier one, counted until the
                 optimum is reached to 0.1 %
    marked       share that no model believed safe, as the method said itself
    predicted    mean safe probability that was predicted; it should equal `safe`
    cpu          seconds of CPU per 10 trials: ask and tell, without the evaluations

The local method's constants were chosen on seeds 0 to 2 and 10 to 14. Seeds 3 to 7 were run with a version
before the deviations of `gp.warped_process` were computed by the inverse factor; seeds 20 to 26 report.

A run that is in the results is not run again; each is kept as soon as it is over.

    python benchmarks/outside.py run --methods hdsafebo_local scbo --seeds 20 21 22
    python benchmarks/outside.py table
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from outside_botorch import QLogNei
from outside_problems import NAMES, Outside, outside_problem

from hdsafebo import make_optimizer
from hdsafebo.optimizers.registry import method_class
from hdsafebo.problem import FunctionProblem
from hdsafebo.typing import FloatArray

OUT = Path(__file__).parents[1] / "reports" / "reference" / "benchmarks" / "outside"
METHODS = ("hdsafebo_local", "hdsafebo", "linebo", "config", "scbo", "cei_prob", "cmaes", "qlognei")
REPORTED = tuple(range(20, 27))
BATCH = 5
CLOSE = 1e-3
REACHED = 1e-3
"""Of the optimum's size; of 1 where the optimum is 0."""

Ask = Callable[[int], FloatArray]
Tell = Callable[[FloatArray, FloatArray], None]


def peer(method: str, problem: FunctionProblem, seed: int, x: FloatArray) -> tuple[Ask, Tell, Any]:
    """What asks and what tells, told of the initial inputs; and the optimiser, None for BoTorch's."""
    objective, slack = problem.function(x)
    if method == "qlognei":
        botorch = QLogNei(problem.bounds, seed)
        botorch.tell(x, objective, slack)
        asked: list[FloatArray] = []

        def ask(n: int) -> FloatArray:
            asked.append(botorch.ask(n))
            return asked[-1]

        return ask, lambda f, g: botorch.tell(asked[-1], f, g), None
    kind, _ = method_class(method)
    marking = {"empty_safe_set": "mark"} if "empty_safe_set" in kind.Settings.model_fields else {}
    optimizer = make_optimizer(method, problem, seed=seed, **marking)
    optimizer.observe(x, objective, slack, initial=True)
    return (
        lambda n: optimizer.ask(n).x,
        lambda f, g: optimizer.tell(optimizer.trials[-len(f) :], f, g),
        optimizer,
    )


def measure(method: str, outside: Outside, seed: int, x: FloatArray | None = None) -> dict[str, Any]:
    """One run; see the module. `x` are other initial inputs than the problem's."""
    problem = outside.problem(seed)
    x = outside.initial(seed) if x is None else x
    ask, tell, optimizer = peer(method, problem, seed, x)
    objective, slack = outside.true(x)
    start = len(x)
    best, cpu = [_best(objective, slack)], 0.0
    while len(x) - start < outside.trials:
        before = time.process_time()
        fresh = ask(BATCH)
        cpu += time.process_time() - before
        results = problem.function(fresh)
        before = time.process_time()
        tell(*results)
        cpu += time.process_time() - before
        values, slacks = outside.true(fresh)
        x, objective, slack = np.vstack([x, fresh]), np.append(objective, values), np.vstack([slack, slacks])
        best.append(_best(objective, slack))
    asked = None if optimizer is None else optimizer.trials[start:]
    predicted = None
    if asked is not None and np.isfinite(asked.predicted_safe_probability).all():
        predicted = float(asked.predicted_safe_probability.mean())
    return {
        "best": best,
        "safe": float((slack[start:] >= 0).all(axis=1).mean()),
        "violation": float((np.maximum(0.0, -slack[start:]) / outside.violation_scale).sum(axis=1).mean()),
        "near": _near(outside, x, start, best),
        "marked": None if asked is None else float(asked.marked_unsafe.mean()),
        "predicted": predicted,
        "cpu": 10.0 * cpu / outside.trials,
    }


def _best(objective: FloatArray, slack: FloatArray) -> float:
    return float(objective[(slack >= 0).all(axis=1)].max())


def _near(outside: Outside, x: FloatArray, start: int, best: list[float]) -> float:
    """Share of the asked trials, until the optimum is reached, that lie close to an earlier one."""
    unit = (x - outside.bounds[0]) / (outside.bounds[1] - outside.bounds[0])
    goal = outside.optimum - REACHED * (abs(outside.optimum) or 1.0)
    rounds = next((r for r, value in enumerate(best) if value >= goal), len(best) - 1)
    until = start + max(1, rounds) * BATCH
    near = [np.linalg.norm(unit[:i] - unit[i], axis=1).min() < CLOSE for i in range(start, until)]
    return float(np.mean(near))


def run(problems: list[str], methods: list[str], seeds: list[int], out: Path) -> None:
    """All runs that are not in the results."""
    out.mkdir(parents=True, exist_ok=True)
    for name in problems:
        outside = outside_problem(name)
        for method in methods:
            for seed in seeds:
                path = out / f"{method}.json"
                results = json.loads(path.read_text()) if path.exists() else {}
                if str(seed) in results.get(name, {}):
                    continue
                row = measure(method, outside, seed)
                results.setdefault(name, {})[str(seed)] = row
                partial = path.with_suffix(".part")
                partial.write_text(json.dumps(results, sort_keys=True, indent=1) + "\n")
                partial.replace(path)
                print(f"{name} {method} {seed} " + _line(row), flush=True)


def _line(row: dict[str, Any]) -> str:
    shown = {"best": row["best"][-1]} | {key: row[key] for key in row if key != "best"}
    return " ".join(f"{key} {'-' if value is None else format(value, '.5g')}" for key, value in shown.items())


def table(out: Path) -> dict[str, dict[str, dict[str, Any]]]:
    """By problem and method over the reported seeds: median objective at 50 trials and the end, means."""
    rows: dict[str, dict[str, dict[str, Any]]] = {}
    for method in METHODS:
        path = out / f"{method}.json"
        results = json.loads(path.read_text()) if path.exists() else {}
        for name in NAMES:
            runs = [results[name][str(s)] for s in REPORTED if str(s) in results.get(name, {})]
            if not runs:
                continue
            row: dict[str, Any] = {"seeds": len(runs), "optimum": outside_problem(name).optimum}
            for key, at in (("best_50", 50 // BATCH), ("best", -1)):
                values = [r["best"][at] for r in runs]
                row[key] = float(np.median(values))
                row[key + "_range"] = [float(min(values)), float(max(values))]
            for key, centre in (
                ("safe", np.mean), ("violation", np.mean), ("near", np.mean), ("marked", np.mean),
                ("predicted", np.mean), ("cpu", np.median),
            ):  # fmt: skip
                row[key] = None if runs[0][key] is None else float(centre([r[key] for r in runs]))
            rows.setdefault(name, {})[method] = row
    return rows


def main() -> None:
    """Run, or show the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("action", choices=("run", "table"))
    parser.add_argument("--problems", nargs="+", choices=NAMES, default=list(NAMES), metavar="NAME")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS), metavar="METHOD")
    parser.add_argument("--seeds", nargs="+", type=int, default=list(REPORTED), help="default: 20 to 26")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of the results")
    arguments = parser.parse_args()
    if arguments.action == "run":
        run(arguments.problems, arguments.methods, arguments.seeds, arguments.out)
        return
    rows = table(arguments.out)
    for name, methods in rows.items():
        print(f"{name} (optimum {next(iter(methods.values()))['optimum']:.6g})")
        for method, row in methods.items():
            shown = {key: row[key] for key in row if key != "optimum" and not key.endswith("range")}
            print(f"  {method:15s} {_line(shown | {'best': [row['best']]})}")
    (arguments.out / "table.json").write_text(json.dumps(rows, indent=1, sort_keys=True) + "\n")


if __name__ == "__main__":
    main()
