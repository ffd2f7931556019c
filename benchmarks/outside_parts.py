"""What each part of the constrained search is worth: the part taken out, on development seeds.

    python benchmarks/outside_parts.py --write

Runs are those of `outside.py` (see there for what is recorded), on the problems of `PROBLEMS` and the seeds
0 to 2, on which the search was developed. A row has, by problem, the median gap to the published optimum in
its units, and over all problems the means of safe share, near-duplicates and marked trials; and the safe
share of runs that know five safe points in one place when they begin.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from unittest.mock import patch

import numpy as np
from outside import measure
from outside_problems import outside_problem

from hdsafebo.files.atomic import write_json
from hdsafebo.gp import warped_fit, warped_surrogate
from hdsafebo.gp.warped_process import Posteriors
from hdsafebo.optimizers.local.constrained import batch, expectations, search
from hdsafebo.progress import track
from hdsafebo.typing import FloatArray

PROBLEMS = ("pressure", "welded", "tension", "hartmann6_noisy", "ackley10", "g07")
SEEDS = (0, 1, 2)
OUT = Path(__file__).parents[1] / "reports" / "reference" / "benchmarks" / "outside_parts.json"

_loss = warped_fit._loss


def _equal_lengths(theta: FloatArray, x: FloatArray, target: FloatArray) -> tuple[float, FloatArray]:
    """The loss of a fit along equal length scales: what begins equal stays equal."""
    value, gradient = _loss(theta, x, target)
    gradient[:-1] = gradient[:-1].mean()
    return value, gradient


PARTS: dict[str, list[tuple[object, str, object]]] = {
    "nothing": [],
    "warp": [(warped_surrogate, "warp_scales", lambda y, centre: ())],
    "a length scale per input": [(warped_fit, "_loss", _equal_lengths)],
    "shared prior of length scales": [(warped_fit, "_DIFFERENCE", 10.0)],
    "kept margin": [(search, "_KEPT", 0.0)],
    "largest deviation": [(search, "_CAP", np.inf)],
    "1.5 deviations": [(warped_surrogate, "_DISTRUST", 1.0)],
    "distrust after errors": [
        (expectations.Expectations, "inflation", lambda self, safety: np.ones(len(safety)))
    ],
    "probes": [(batch.Batch, "probe", lambda self, distance: None)],
    "objective told its means": [(Posteriors, "believing", lambda self, points: self)],
    "look everywhere": [(search, "_STALLED_ROUNDS", 1000)],
}
"""What is taken out, and the names that stand in for it."""


@contextmanager
def without(part: str) -> Iterator[None]:
    """The search without a part."""
    with ExitStack() as stack:
        for owner, name, value in PARTS[part]:
            stack.enter_context(patch.object(owner, name, value))
        yield


def row(part: str, advance: Callable[[], None]) -> dict[str, object]:
    """Figures without a part."""
    gaps, shares, together = {}, [], []
    for name in PROBLEMS:
        outside = outside_problem(name)
        runs = []
        for seed in SEEDS:
            with without(part):
                runs.append(measure("hdsafebo_local", outside, seed))
                one_place = measure("hdsafebo_local", outside, seed, outside.initial_in_one_place(seed))
            together.append(one_place["safe"])
            advance()
        gaps[name] = float(np.median([outside.optimum - run["best"][-1] for run in runs]))
        shares += [[run[key] for key in ("safe", "near", "marked")] for run in runs]
    safe, near, marked = (float(v) for v in np.mean(shares, axis=0))
    one = float(np.mean(together))
    return {"gap": gaps, "safe": safe, "near": near, "marked": marked, "safe_from_one_place": one}


def main() -> None:
    """Measure, print and keep."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    parser.add_argument("--write", action="store_true", help=f"keep the numbers in {OUT}")
    arguments = parser.parse_args()
    rows = {}
    bar = iter(track(range(len(arguments.parts) * len(PROBLEMS) * len(SEEDS)), "runs"))
    for part in arguments.parts:
        rows[part] = row(part, lambda: next(bar, None))
        gaps = " ".join(f"{name} {gap:.4g}" for name, gap in rows[part]["gap"].items())  # type: ignore[attr-defined]
        shares = " ".join(f"{name} {share:.4f}" for name, share in rows[part].items() if name != "gap")
        print(f"without {part}: {shares} | {gaps}", flush=True)
    if arguments.write:
        write_json(OUT, {"seeds": list(SEEDS), "without": rows})


if __name__ == "__main__":
    main()
