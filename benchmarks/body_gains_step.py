"""First step of CMA-ES over the seven gains of a body's reflex, chosen on development seeds.

The body's task has this baseline at its best: of the steps at which at least 0.95 of the trials of all seeds
are safe, the one with the highest mean of the best safe returns. Each run has the 40 initial reflexes of its
seed and 60 further trials in batches of 6. Runs that the result file has are not computed again.

    python benchmarks/body_gains_step.py --write
"""

from __future__ import annotations

import argparse
import json
import os
from itertools import product
from pathlib import Path
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import numpy as np  # noqa: E402  (after the thread limits)

from hdsafebo import make_optimizer  # noqa: E402
from hdsafebo.campaign.executor import process_pool  # noqa: E402
from hdsafebo.files.atomic import write_json  # noqa: E402
from hdsafebo.problems.body import body_policies  # noqa: E402
from hdsafebo.problems.reflexes import ReflexGainsProblem  # noqa: E402
from hdsafebo.runs.best_trial import SAFE_ENOUGH  # noqa: E402
from hdsafebo.trials import Trials  # noqa: E402

OUT = Path(__file__).parents[1] / "reports" / "reference" / "benchmarks" / "body_gains_step.json"
STEPS = (0.05, 0.1)
"""In widths of the box of gains."""
SEEDS = (0, 1, 2, 3)
INITIAL, TRIALS, BATCH = 40, 60, 6
SHOWN = (6, 18, 30, 60)


def run(step: float, seed: int) -> dict[str, Any]:
    """Best safe return after some of the trials, and which share of all of them was safe."""
    problem = ReflexGainsProblem(body_policies())
    optimizer = make_optimizer("cmaes", problem, seed=seed, step=step)
    x, _ = problem.initial(INITIAL, np.random.default_rng(seed))
    known = problem.evaluate(Trials.pending(x, x, len(problem.safety)))
    optimizer.observe(x, known.objective, known.safety, status=known.status(), initial=True)
    for _ in range(TRIALS // BATCH):
        asked = optimizer.ask(BATCH)
        result = problem.evaluate(asked)
        optimizer.tell(asked, result.objective, result.safety, status=result.status())
    safe = problem.is_safe(optimizer.trials.safety)
    returns = np.where(safe, optimizer.trials.objective, -np.inf)
    best = {str(n): round(float(returns[: INITIAL + n].max()), 1) for n in (0, *SHOWN)}
    return {"step": step, "seed": seed, "best_after": best, "safe_share": float(safe[INITIAL:].mean())}


def chosen(rows: list[dict[str, Any]]) -> float:
    """The step that the rule above chooses."""
    found = {}
    for step in STEPS:
        of_step = [row for row in rows if row["step"] == step]
        if np.mean([row["safe_share"] for row in of_step]) >= SAFE_ENOUGH:
            found[step] = np.mean([row["best_after"][str(TRIALS)] for row in of_step])
    return max(found, key=lambda step: found[step])


def main() -> None:
    """Compute what is missing, print, and keep the result if wanted."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--workers", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--write", action="store_true", help=f"keep the result in {OUT.name}")
    given = parser.parse_args()
    rows = json.loads(OUT.read_text(encoding="utf-8"))["runs"] if OUT.is_file() else []
    missing = [pair for pair in product(STEPS, SEEDS) if pair not in {(r["step"], r["seed"]) for r in rows}]
    with process_pool(given.workers) as executor:
        rows += executor.map(run, *zip(*missing, strict=True)) if missing else []
    rows.sort(key=lambda row: (row["step"], row["seed"]))
    for row in rows:
        print(json.dumps(row))
    found = {"trials": TRIALS, "least_safe": SAFE_ENOUGH, "chosen": chosen(rows), "runs": rows}
    print(f"chosen: {found['chosen']}")
    if given.write:
        write_json(OUT, found)


if __name__ == "__main__":
    main()
