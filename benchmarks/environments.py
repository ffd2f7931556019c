"""Safe search over policies of environments: Hopper, HalfCheetah, a body after a push, and MyoSuite's pen.

Every run is a file of its own that holds all trials' results and a digest of the code; a run that the
present code computed is not computed again, and one that was killed goes on from its last saved round. Seeds
below 100 are for choosing, those of reported figures are 1000 and up. A summary replaces what was kept of its
tasks and methods.
The pen needs MyoSuite, which is not among this project's packages. A folder of its own leaves those
as they are:

    pip install --no-deps --target pen myosuite==3.0.0 ml-collections flatten_dict termcolor h5py colorednoise
    PYTHONPATH=pen python benchmarks/environments.py --tasks pen --methods hdsafebo_local cmaes_smallest

    python benchmarks/environments.py --tasks hopper cheetah --methods hdsafebo_local cmaes --seeds 1000 1001
    python benchmarks/environments.py --tasks body --methods hdsafebo_local --initial 40 --trials 300
    python benchmarks/environments.py --summary
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import numpy as np  # noqa: E402  (after the thread limits)

from hdsafebo import EpisodeSafety, GymnasiumPolicies, Safety, gaussian_design, lasts, survives  # noqa: E402
from hdsafebo.campaign.run_spec import code_digest  # noqa: E402
from hdsafebo.errors import NoSafePointError, SurrogateError  # noqa: E402
from hdsafebo.files.atomic import replacing, write_json  # noqa: E402
from hdsafebo.optimizers.registry import load_optimizer, make_optimizer  # noqa: E402
from hdsafebo.policies.synergies import ActionSynergies  # noqa: E402
from hdsafebo.problem import Problem  # noqa: E402
from hdsafebo.problems.body import UNSEEN_PUSHES, body_policies, torque_synergies  # noqa: E402
from hdsafebo.problems.reflexes import ReflexGainsProblem  # noqa: E402
from hdsafebo.trials import Trials  # noqa: E402

ROOT = Path(__file__).parents[1]
RUNS = ROOT / "data" / "environments"
OUT = ROOT / "reports" / "reference" / "benchmarks" / "environments.json"
BATCH = 10
SAVED_EVERY = 5
"""Rounds between two saved states: that of a body's search has a hundred megabytes."""
_PITCH = 1
"""Observation of HalfCheetah that is the angle of its torso, rad."""


@dataclass(frozen=True)
class Method:
    """A method as it runs here.

    Attributes:
        algorithm: name in the registry.
        settings: of it.
        space: "weights", "torques" (through joint-torque synergies) or "gains" (of the reflex), the last two
            for bodies only.
    """

    algorithm: str
    settings: dict[str, Any] = field(default_factory=dict)
    space: str = "weights"


METHODS = {
    "hdsafebo_local": Method("hdsafebo_local"),
    "cmaes": Method("cmaes"),
    "cmaes_small": Method("cmaes", {"step": 0.03}),
    "cmaes_smallest": Method("cmaes", {"step": 0.004}),
    "ars": Method("ars"),
    "ars_small": Method("ars", {"noise": 0.002, "step": 0.004}),
    "local_random": Method("local_random"),
    "sobol": Method("sobol"),
    "scbo_torques": Method("scbo", space="torques"),
    "hdsafebo_local_gains": Method("hdsafebo_local", space="gains"),
    "cmaes_gains": Method("cmaes", space="gains"),
}


def hopper() -> GymnasiumPolicies:
    """Hopper; a safe policy stays up for at least 75 steps, 0.6 s."""
    design = gaussian_design(0.02, 0.5)
    return GymnasiumPolicies("Hopper-v5", [lasts(75)], seeds=(1, 2), horizon=300, design=design)


def cheetah() -> GymnasiumPolicies:
    """HalfCheetah; the torso of a safe policy pitches by at most 1 rad."""

    def margin(episode: Any) -> float:
        return 1.0 - float(np.abs(episode.observations[:, _PITCH]).max())

    pitch = EpisodeSafety(Safety("pitch", 0.0), margin)
    return GymnasiumPolicies("HalfCheetah-v5", [pitch], seeds=(1, 2), horizon=200)


def pen() -> GymnasiumPolicies:
    """MyoSuite's pen twirl with 39 muscles; a safe policy does not drop the pen."""
    import myosuite  # type: ignore[import-not-found]  # noqa: F401  (registers its environments)

    design = gaussian_design(0.05, 0.5)
    return GymnasiumPolicies(
        "myoHandPenTwirlFixed-v0", [survives()], seeds=(1,), horizon=50, design=design, box=0.5
    )


TASKS: dict[str, Callable[[], GymnasiumPolicies]] = {
    "hopper": hopper,
    "cheetah": cheetah,
    "pen": pen,
    "legs": lambda: body_policies("myolegs", least_time=1.0, most_load=300.0),
    "body": body_policies,
    "body_one_push": lambda: body_policies(pushes=(1,)),
}


def searched(policies: GymnasiumPolicies, space: str) -> tuple[Problem, ActionSynergies | None]:
    """The problem that a method meets, and its embedding."""
    if space == "gains":
        return ReflexGainsProblem(policies), None
    return policies, torque_synergies(policies) if space == "torques" else None


def code_of(name: str) -> str:
    """Digest of what computes a method's runs; the task `body` has all modules of policies behind it."""
    return code_digest("body", METHODS[name].algorithm)


def run(task: str, name: str, seed: int, initial: int, trials: int) -> dict[str, Any]:
    """One run, from its saved state if there is one."""
    method, work = METHODS[name], RUNS / f"{task}-{name}-{seed}-{initial}-{trials}"
    policies = TASKS[task]()
    problem, embedding = searched(policies, method.space)
    state, seconds = work.with_suffix(f".{code_of(name)[:12]}.state"), []
    physics = 0.0
    if state.exists():
        optimizer = load_optimizer(method.algorithm, state, problem, embedding)
    else:
        optimizer = make_optimizer(
            method.algorithm, problem, embedding=embedding, seed=seed, **method.settings
        )
        known = initial_trials(problem, task, method.space, seed, initial)
        optimizer.observe(known.x, known.objective, known.safety, status=known.status, initial=True)
    stopped = None
    while len(optimizer.trials) < initial + trials:
        start = time.process_time()
        try:
            asked = optimizer.ask(min(BATCH, initial + trials - len(optimizer.trials)))
        except (NoSafePointError, SurrogateError) as error:
            stopped = str(error)
            break
        played = time.process_time()
        results = problem.evaluate(asked)
        told = time.process_time()
        optimizer.tell(asked, results.objective, results.safety, status=results.status())
        seconds.append(played - start + time.process_time() - told)
        physics += told - played
        if optimizer.round % SAVED_EVERY == 0:
            optimizer.save(state)
        best, done = optimizer.best(), len(optimizer.trials)
        shown = "none" if best is None else f"{float(best.objective):.1f}"
        share = optimizer.feasible[initial:].mean()
        print(f"{task} {name} {seed}: {done} trials, best {shown}, safe {share:.3f}", flush=True)
    best, table = optimizer.best(), optimizer.trials
    row = {
        "task": task,
        "method": name,
        "code": code_of(name),
        "seed": seed,
        "initial": initial,
        "dimension": optimizer.space.dimension,
        "objective": np.where(table.completed, table.objective, 0.0).tolist(),
        "feasible": optimizer.feasible.tolist(),
        "marked": int(table.marked_unsafe.sum()),
        "failed": int((~table.completed).sum()),
        "abstained": stopped,
        "round_cpu_s": float(np.median(seconds)) if seconds else None,
        "physics_s": physics,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "unseen": None if best is None else unseen(task, policies, problem, best.x),
    }
    if best is not None and method.space == "weights":
        policies.save_policy(best.x, work.with_suffix(".safetensors"))
    state.unlink(missing_ok=True)
    return row


def initial_trials(problem: Problem, task: str, space: str, seed: int, n: int) -> Trials:
    """Initial trials and their results, the same for all methods that search one space; kept in a file."""
    kind = "gains" if space == "gains" else "weights"
    path = RUNS / f"initial-{task}-{kind}-{seed}-{n}.npz"
    if path.exists():
        with np.load(path) as kept:
            trials = Trials.pending(kept["x"], kept["x"], len(problem.safety), status=kept["status"])
            return Trials(**(vars(trials) | {k: kept[k] for k in ("objective", "safety")}))
    x, _ = problem.initial(n, np.random.default_rng(seed))
    trials = Trials.pending(x, x, len(problem.safety))
    trials = trials.with_results(problem.evaluate(trials))
    with replacing(path) as temporary:
        columns = {k: getattr(trials, k) for k in ("x", "objective", "safety", "status")}
        with temporary.open("wb") as file:
            np.savez(file, **columns)
    return trials


def unseen(task: str, policies: GymnasiumPolicies, problem: Problem, x: np.ndarray) -> dict[str, list[float]]:
    """Steps and returns of a policy on the evaluation seeds, and on seeds that no trial met."""
    weights = problem.weights(x) if isinstance(problem, ReflexGainsProblem) else x
    known = policies.play(weights)
    others = policies.play(weights, seeds=UNSEEN_PUSHES)
    return {
        "steps": [e.steps for e in known],
        "unseen_steps": [e.steps for e in others],
        "unseen_return": [e.total_reward for e in others],
    }


def summary(seeds: list[int]) -> list[dict[str, Any]]:
    """One row per task and method: medians over these seeds with their spread; of the present code."""
    groups: dict[tuple[str, str, int], list[dict[str, Any]]] = {}
    for path in sorted(RUNS.glob("*.json")):
        row = json.loads(path.read_text(encoding="utf-8"))
        if row["seed"] not in seeds:
            continue
        if not is_present(row):
            print(f"left out, since other code computed it: {path.name}")
            continue
        planned = row["initial"] + int(path.stem.rpartition("-")[2])  # a run that abstained is shorter
        groups.setdefault((row["task"], row["method"], planned), []).append(row)
    return [_summary_of(*key, rows) for key, rows in sorted(groups.items())]


def is_present(row: dict[str, Any]) -> bool:
    """Whether the present code computed a run."""
    return bool(row.get("code") == code_of(row["method"]))


def _summary_of(task: str, method: str, trials: int, rows: list[dict[str, Any]]) -> dict[str, Any]:
    best, safety, start = [], [], []
    for row in rows:
        values, feasible = np.array(row["objective"]), np.array(row["feasible"])
        first = row["initial"]
        best.append(float(values[feasible].max(initial=-np.inf)))
        start.append(float(values[:first][feasible[:first]].max(initial=-np.inf)))
        safety.append(float(feasible[first:].mean()))
    found = [b for b in best if np.isfinite(b)]
    return {
        "task": task,
        "method": method,
        "code": code_of(method),
        "trials": trials,
        "seeds": [row["seed"] for row in rows],
        "best": best if len(found) == len(best) else [b if np.isfinite(b) else None for b in best],
        "best_median": float(np.median(found)) if found else None,
        "best_spread": float(np.ptp(found)) if found else None,
        "best_initial_median": float(np.median([s for s in start if np.isfinite(s)] or [0.0])),
        "safety": safety,
        "marked": [row["marked"] for row in rows],
        "round_cpu_s": float(np.median([row["round_cpu_s"] or 0.0 for row in rows])),
        "peak_mb": float(max(row["peak_mb"] for row in rows)),
        "unseen": [row["unseen"] for row in rows],
        "abstained": [row["abstained"] for row in rows],
    }


def main() -> None:
    """Run what is missing, then print and keep the summary."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=["hopper", "cheetah"])
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=["hdsafebo_local", "cmaes", "sobol"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[1000, 1001, 1002, 1003, 1004])
    parser.add_argument("--initial", type=int, default=40, help="initial policies (default: 40)")
    parser.add_argument("--trials", type=int, default=250, help="further trials (default: 250)")
    parser.add_argument("--summary", action="store_true", help="run nothing, print the runs that are there")
    parser.add_argument("--write", action="store_true", help=f"keep the summary in {OUT.relative_to(ROOT)}")
    given = parser.parse_args()
    RUNS.mkdir(parents=True, exist_ok=True)
    jobs = [] if given.summary else product(given.seeds, given.tasks, given.methods)
    for seed, task, method in jobs:
        path = RUNS / f"{task}-{method}-{seed}-{given.initial}-{given.trials}.json"
        if not path.exists() or not is_present(json.loads(path.read_text(encoding="utf-8"))):
            row = run(task, method, seed, given.initial, given.trials)
            with replacing(path) as temporary:
                temporary.write_text(json.dumps(row) + "\n", encoding="utf-8")
    rows = summary(given.seeds)
    for row in rows:
        middle, spread = row["best_median"], row["best_spread"]
        shown = "-" if middle is None else f"{middle:.1f} (spread {spread:.1f})"
        safe = ", ".join(f"{s:.3f}" for s in row["safety"])
        print(f"{row['task']:14s}{row['method']:22s}{row['trials']:5d}  best {shown}  safe {safe}")
    if given.write:
        before = json.loads(OUT.read_text(encoding="utf-8")) if OUT.is_file() else []
        kept = {_key(row): row for row in [*before, *rows]}
        write_json(OUT, [kept[key] for key in sorted(kept)])


def _key(row: dict[str, Any]) -> tuple[str, str, int]:
    return row["task"], row["method"], row["trials"]


if __name__ == "__main__":
    main()
