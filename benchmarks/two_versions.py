"""Whether a change made a method worse: run files that two versions of the code wrote, beside each other.

By version: best safe objective of every seed, safe share, mean violation. Of both: the share of trials with
equal outcomes, and the p-value of Wilcoxon's signed-rank test of the best objectives, by seed. Both files are
of the same task with the same initial trials; a checkout of the former version writes its own.

    python benchmarks/two_versions.py ../former/data/runs/scs_st-hdsafebo_local.parquet \\
        data/runs/scs_st_informed-hdsafebo_local.parquet --names 5e937f2 d1328ea --write
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import wilcoxon

from hdsafebo.files.atomic import write_json

OUT = Path(__file__).parents[1] / "reports" / "reference" / "benchmarks" / "two_versions.json"
_OUTCOMES = ["objective", "safety"]


def figures(trials: pd.DataFrame) -> dict[str, object]:
    """Of the trials of a run file."""
    chosen, best = trials[~trials["initial"]], best_of(trials)
    return {
        "trials": len(chosen) // len(best),
        "best": {str(seed): float(value) for seed, value in best.items()},
        "best_median": float(best.median()),
        "safe": float(chosen["safe"].mean()),
        "violation": float(chosen["violation"].mean()),
    }


def best_of(trials: pd.DataFrame) -> pd.Series:
    """Best safe objective by seed."""
    return trials[trials["safe"]].groupby("seed")["objective"].max()


def equal(former: pd.DataFrame, present: pd.DataFrame) -> float:
    """Share of trials whose outcomes are the same to the last digit."""
    keys = ["seed", "trial"]
    pairs = former.merge(present, on=keys, suffixes=("", "_now"))
    same = [pairs[name].to_numpy() == pairs[f"{name}_now"].to_numpy() for name in _OUTCOMES]
    return float(np.mean(np.all(same, axis=0)))


def main() -> None:
    """Read, print and keep."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("former", type=Path, help="run file of the former version")
    parser.add_argument("present", type=Path, help="run file of the present version")
    parser.add_argument("--names", nargs=2, required=True, metavar="REVISION", help="of the two versions")
    parser.add_argument("--write", action="store_true", help=f"keep the numbers in {OUT}")
    arguments = parser.parse_args()
    former, present = (pd.read_parquet(path) for path in (arguments.former, arguments.present))
    difference = (best_of(present) - best_of(former)).to_numpy()
    row = {
        "former": {"revision": arguments.names[0], **figures(former)},
        "present": {"revision": arguments.names[1], **figures(present)},
        "equal_trials": equal(former, present),
        "p": float(wilcoxon(difference).pvalue) if difference.any() else 1.0,
    }
    print(json.dumps(row, indent=1))
    if arguments.write:
        kept = json.loads(OUT.read_text(encoding="utf-8")) if OUT.exists() else {}
        write_json(OUT, kept | {arguments.present.stem: row})


if __name__ == "__main__":
    main()
