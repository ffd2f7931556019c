"""The first step of CMA-ES on the tasks of a family in one of its settings, chosen on development seeds.

Every step runs on every task and seed with the whole budget of the parameters. The chosen one has the
highest best safe objective at the end, as a share of the highest of all steps on the same task and seed, in
the mean; it is what `cmaes_tuned.step` is to be in `tasks.FAMILY.settings`, or in `informed.settings` of the
family. The default, a quarter of the box, is among them. On digits the informed setting changes nothing that
CMA-ES uses, so its tasks need not be run. What tasks need (embeddings, synergies) is read below `--root`.

    python benchmarks/cmaes_step.py digits_{0..9} --seeds 0 1 2 3 4 --write
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from itertools import product
from pathlib import Path
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import numpy as np  # noqa: E402  (after the thread limits)

from hdsafebo.campaign.executor import process_pool  # noqa: E402
from hdsafebo.campaign.run_spec import RunSpec  # noqa: E402
from hdsafebo.campaign.runner import run  # noqa: E402
from hdsafebo.files.atomic import write_json  # noqa: E402
from hdsafebo.params import load_params  # noqa: E402
from hdsafebo.problems.registry import INFORMED_SUFFIX, family_of, is_informed  # noqa: E402

ROOT = Path(__file__).parents[1]
OUT = ROOT / "reports" / "reference" / "benchmarks" / "cmaes_step.json"
METHOD = "cmaes_tuned"
STEPS = (0.01, 0.025, 0.05, 0.1, 0.25)
"""First standard deviations, in widths of the box."""


def outcome(root: Path, task: str, step: float, seed: int) -> dict[str, Any]:
    """Best safe objective and safe share of a run; None where no trial was safe."""
    plain = load_params(root / "params.yaml").model_dump(mode="json")
    family = plain["tasks"][family_of(task)]
    for settings in (family["settings"], family.get("informed", {}).get("settings", {})):
        settings[METHOD] = {"step": step}
    with tempfile.TemporaryDirectory() as home:
        rows = run(RunSpec(task, METHOD, seed, plain, str(root), home, home)).rows
    safe, chosen = np.asarray(rows["safe"], bool), ~np.asarray(rows["initial"], bool)
    best = float(np.max(np.asarray(rows["objective"])[safe])) if safe.any() else None
    share = round(float(safe[chosen].mean()), 4)
    return {"task": task, "step": step, "seed": seed, "best": best, "safe": share}


def shares(runs: list[dict[str, Any]]) -> dict[float, float]:
    """By step, the mean share of the highest objective of all steps, over seeds with a safe trial."""
    most: dict[tuple[str, int], float] = {}
    for one in runs:
        key = one["task"], one["seed"]
        most[key] = max(most.get(key, 0.0), one["best"] or 0.0)
    found = {}
    for step in sorted({one["step"] for one in runs}):
        own = [one for one in runs if one["step"] == step]
        met = [(one["best"] or 0.0, most[one["task"], one["seed"]]) for one in own]
        parts = [best / highest for best, highest in met if highest > 0]
        found[step] = round(float(np.mean(parts)), 4)
    return found


def main() -> None:
    """Run what is asked for, and keep it by family."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tasks", nargs="+", help="of one family and setting, with positive objectives")
    parser.add_argument("--steps", nargs="+", type=float, default=list(STEPS), metavar="STEP")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2], help="below 100 (default: 0 1 2)")
    parser.add_argument("--root", type=Path, default=ROOT, help="project whose parameters and files are used")
    parser.add_argument("--workers", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--write", action="store_true", help=f"keep the result in {OUT.name}")
    given = parser.parse_args()
    kinds = {family_of(task) + INFORMED_SUFFIX * is_informed(task) for task in given.tasks}
    if len(kinds) > 1 or max(given.seeds) >= 100:
        parser.error("expected tasks of one family in one setting, and seeds below 100")
    jobs = [(given.root.resolve(), *job) for job in product(given.tasks, given.steps, given.seeds)]
    with process_pool(given.workers) as executor:
        runs = []
        for one in executor.map(outcome, *zip(*jobs, strict=True)):
            runs.append(one)
            print(json.dumps(one), flush=True)
    by_step = shares(runs)
    chosen = max(by_step, key=lambda step: by_step[step])
    print(f"mean share of the highest: {by_step}; chosen: {chosen}")
    if given.write:
        kept = json.loads(OUT.read_text(encoding="utf-8")) if OUT.is_file() else {}
        kept[kinds.pop()] = {
            "chosen": chosen,
            "mean_share": {str(s): v for s, v in by_step.items()},
            "runs": runs,
        }
        write_json(OUT, kept, sort_keys=True)


if __name__ == "__main__":
    main()
