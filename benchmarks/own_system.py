"""Three systems of `examples/` over several seeds: how often limits are broken, how good the best becomes.

Unsafe trials are counted as measured (what a user sees) and as they truly are, without noise. The mixed
system has a linear rule, the list a payload that is known per day. Days heavier than any before are counted
apart, and so are trials that were marked: nothing was believed safe, and the safest was left to a person. CPU
time is that of one `ask` with 100 trials known.

    python benchmarks/own_system.py --write
"""

from __future__ import annotations

import argparse
import io
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

EXAMPLES = Path(__file__).parents[1] / "examples"
sys.path.insert(0, str(EXAMPLES))

import arm_gains  # noqa: E402
import crane_payload  # noqa: E402
import gripper_mixed  # noqa: E402
import plants  # noqa: E402

from hdsafebo import Study, System  # noqa: E402
from hdsafebo.files.atomic import write_json  # noqa: E402

OUTPUT = Path(__file__).parents[1] / "reports" / "reference" / "benchmarks" / "own_system.json"
DAYS = 15
LATER = 100
"""Trials that are known when the time of one `ask` is taken."""


def keeps(system: System, outcomes: Mapping[str, float]) -> bool:
    """Whether every limit is kept."""
    return all(
        (limit.at_least is None or outcomes[limit.name] >= limit.at_least)
        and (limit.at_most is None or outcomes[limit.name] <= limit.at_most)
        for limit in system.limits
    )


def chosen(study: Study) -> list[dict[str, Any]]:
    """The suggestions that were run."""
    table = study.to_dataframe()
    return table[~table["initial"] & (table["status"] == "completed")].to_dict("records")


def gripper(seed: int) -> dict[str, float]:
    """60 trials of the mixed system."""
    study = gripper_mixed.main(seed=seed)
    rows = chosen(study)
    best = study.best()
    assert best is not None
    return {
        "trials": len(rows),
        "unsafe_measured": sum(not row["safe"] for row in rows),
        "unsafe_truly": sum(not keeps(study.system, plants.gripper_truth(row)) for row in rows),
        "rule_violated": sum(2 * row["pulses"] + row["rest"] > 14 for row in rows),
        "true_error_of_best": plants.gripper_truth(best.believed.setting)["error"],
    }


def arm(seed: int) -> dict[str, float]:
    """60 trials of the arm by three robots at once."""
    with tempfile.TemporaryDirectory() as folder:
        study = arm_gains.main(Path(folder), seed=seed)
        rows = chosen(study)
        best = study.best()
    assert best is not None
    return {
        "trials": len(rows),
        "unsafe_measured": sum(not row["safe"] for row in rows),
        "unsafe_truly": sum(not keeps(study.system, plants.arm_truth(row)) for row in rows),
        "true_error_of_best": plants.arm_truth(best.believed.setting)["tracking_error"],
    }


def crane(seed: int) -> dict[str, float]:
    """15 days of 12 trials each, with a random payload per day."""
    payloads = [1.0, *np.random.default_rng(seed).uniform(0.5, 4.0, DAYS - 1).round(2).tolist()]
    study = crane_payload.main(payloads, seed=seed)
    rows = chosen(study)
    heaviest, heavier = payloads[0], []
    for payload in payloads:
        if payload > heaviest:
            heavier.append(payload)
            heaviest = payload
    on_heavier = [row for row in rows if row["payload"] in heavier]
    promised = [row for row in on_heavier if not row["marked_unsafe"]]
    marked = [row for row in rows if row["marked_unsafe"]]
    shares = [_share(rows, payload) for payload in payloads[-5:]]
    return {
        "trials": len(rows),
        "unsafe_measured": sum(not row["safe"] for row in rows),
        "unsafe_truly": sum(not _keeps_loaded(row) for row in rows),
        "trials_on_heavier_days": len(on_heavier),
        "promised_on_heavier_days": len(promised),
        "promised_and_unsafe_measured": sum(not row["safe"] for row in promised),
        "promised_and_unsafe_truly": sum(not _keeps_loaded(row) for row in promised),
        "marked": len(marked),
        "marked_and_unsafe_measured": sum(not row["safe"] for row in marked),
        "heavier_days": len(heavier),
        "share_of_the_best_cycles_on_the_last_days": float(np.mean(shares)),
    }


def _keeps_loaded(row: Mapping[str, Any]) -> bool:
    return keeps(crane_payload.SYSTEM, plants.crane_truth(row, row["payload"]))


def _share(rows: list[dict[str, Any]], payload: float) -> float:
    """Best true cycles of a day's safe trials over the best of all stored settings."""
    settings = crane_payload.SETTINGS.to_dict("records")
    true = [plants.crane_truth(s, payload) for s in settings]
    optimum = max(t["cycles"] for t in true if keeps(crane_payload.SYSTEM, t))
    day = [
        plants.crane_truth(r, payload)["cycles"] for r in rows if r["payload"] == payload and _keeps_loaded(r)
    ]
    return max(day, default=0.0) / optimum


def ask_seconds() -> list[float]:
    """CPU time of single asks on the mixed system, around 100 known trials."""
    rng = np.random.default_rng(0)
    study = gripper_mixed.main(trials=LATER - 25, seed=0)
    seconds = []
    for _ in range(20):
        before = time.process_time()
        suggestion = study.ask()
        seconds.append(time.process_time() - before)
        study.tell(suggestion, plants.gripper(suggestion.setting, rng))
    return seconds


def import_seconds(statement: str) -> dict[str, float]:
    """Medians of CPU and wall time of an import in five fresh interpreters."""
    code = (
        "import time; w, c = time.perf_counter(), time.process_time(); "
        f"{statement}; print(time.process_time() - c, time.perf_counter() - w)"
    )
    runs = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        for _ in range(5)
    ]
    cpu, wall = np.median([[float(v) for v in run.stdout.split()] for run in runs], axis=0)
    return {"cpu": round(float(cpu), 3), "wall": round(float(wall), 3)}


def main() -> None:
    """Run all and print or write the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument(
        "--only", choices=["gripper", "arm", "crane"], nargs="*", default=["gripper", "arm", "crane"]
    )
    parser.add_argument("--write", action="store_true", help=f"write {OUTPUT.name}")
    arguments = parser.parse_args()
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    result: dict[str, Any] = {"seeds": list(seeds)}
    for name in arguments.only:
        with redirect_stdout(io.StringIO()):  # what the examples tell their readers
            runs = [{"gripper": gripper, "arm": arm, "crane": crane}[name](seed) for seed in seeds]
        result[name] = {key: [run[key] for run in runs] for key in runs[0]}
    with redirect_stdout(io.StringIO()):
        seconds = ask_seconds()
    result["ask_cpu_seconds"] = {
        "median": round(float(np.median(seconds)), 3),
        "quartiles": [round(float(q), 3) for q in np.quantile(seconds, [0.25, 0.75])],
    }
    imports = ("import hdsafebo", "from hdsafebo import Study, System")
    result["import_seconds"] = {statement: import_seconds(statement) for statement in imports}
    print(json.dumps(result, indent=1))
    if arguments.write:
        write_json(OUTPUT, result)


if __name__ == "__main__":
    main()
