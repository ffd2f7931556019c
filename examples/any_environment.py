"""Safe search over policies of a Gymnasium environment: return and safe share while it runs, then a video.

    python examples/any_environment.py Hopper-v5
    python examples/any_environment.py HalfCheetah-v5 --steps 200 --least-steps 200 --trials 250
    python examples/any_environment.py hdsafebo/PushedLegs-v0 --least-steps 150 --workers 2

A policy is safe when the episode lasts at least so many steps with every evaluation seed. Replace `safety` by
what must not happen to your own system: `budget("cost", 25)` for what the environment reports as
`info["cost"]`, or a function of the episode.
"""

from __future__ import annotations

import argparse
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import numpy as np

import hdsafebo
from hdsafebo import GymnasiumPolicies, HdSafeBOLocal, gaussian_design, lasts
from hdsafebo.campaign.executor import process_pool
from hdsafebo.errors import HdSafeBOError, RenderingUnavailableError

BATCH = 10


def search(problem: GymnasiumPolicies, initial: int, trials: int, seed: int) -> HdSafeBOLocal:
    """Initial policies, then rounds of ten, with a line for each."""
    optimizer = HdSafeBOLocal(problem, seed=seed)
    known = problem.initial_trials(initial, seed)
    optimizer.observe(known.x, known.objective, known.safety, status=known.status, initial=True)
    report("initial policies", optimizer)
    while (done := len(optimizer.trials) - initial) < trials:
        asked = optimizer.ask(min(BATCH, trials - done))
        results = problem.evaluate(asked)
        optimizer.tell(asked, results.objective, results.safety, status=results.status())
        for reason in sorted({r for r in results.reasons or () if r is not None}):
            print(f"  a trial failed: {reason}", flush=True)
        report(f"{len(optimizer.trials) - initial:5d} trials", optimizer)
    return optimizer


def report(what: str, optimizer: HdSafeBOLocal) -> None:
    """One line: the best safe return, and how many of the trials so far were safe."""
    best = optimizer.best()
    asked = ~optimizer.trials.initial
    counted = asked if asked.any() else ~asked
    share = 100 * optimizer.feasible[counted].mean()
    found = "none" if best is None else f"{float(best.objective):9.2f}"
    print(f"{what:>16s}   best safe return {found}   safe {share:5.1f} %", flush=True)


def workers(count: int) -> AbstractContextManager[Executor | None]:
    """Processes that play episodes and end with this one, or none; results do not depend on their number."""
    return nullcontext() if count <= 1 else process_pool(count)


def main(arguments: list[str] | None = None) -> None:
    """Search, say what came of it, save the best policy and film it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("environment", help="id of a registered environment with boxes as spaces")
    parser.add_argument("--steps", type=int, default=300, help="most steps of an episode (default: 300)")
    parser.add_argument("--least-steps", type=int, default=75, help="of a safe episode (default: 75)")
    parser.add_argument("--initial", type=int, default=40, help="initial policies (default: 40)")
    parser.add_argument("--trials", type=int, default=150, help="further trials (default: 150)")
    parser.add_argument("--seed", type=int, default=0, help="of the search (default: 0)")
    parser.add_argument("--workers", type=int, default=1, help="processes that play episodes (default: 1)")
    parser.add_argument("--out", type=Path, default=Path("."), help="folder of policy and video (default: .)")
    given = parser.parse_args(arguments)
    try:
        with workers(given.workers) as executor:
            problem = GymnasiumPolicies(
                given.environment,
                safety=[lasts(given.least_steps)],
                seeds=(1, 2),
                horizon=given.steps,
                design=gaussian_design(0.02, 0.5),
                executor=executor,
            )
            print(f"{problem.name}: {problem.policies.dimension} weights, hdsafebo {hdsafebo.__version__}")
            optimizer = search(problem, given.initial, given.trials, given.seed)
            finish(problem, optimizer, given.out)
    except HdSafeBOError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")


def finish(problem: GymnasiumPolicies, optimizer: HdSafeBOLocal, folder: Path) -> None:
    """Save the best safe policy, play it with seeds that no trial met, and film it."""
    best = optimizer.best()
    if best is None:
        print("no safe policy was found")
        return
    x, name = best.x, problem.name.replace("/", "_")
    problem.save_policy(x, folder / f"{name}.safetensors")
    print(f"policy: {folder / name}.safetensors")
    unseen = [episode.total_reward for episode in problem.play(x, seeds=(1001, 1002, 1003))]
    print(f"return with seeds that no trial met: {np.mean(unseen):.2f}")
    try:
        problem.video(x, folder / f"{name}.mp4")
        print(f"video: {folder / name}.mp4")
    except RenderingUnavailableError as error:
        print(f"no video: {error}")


if __name__ == "__main__":
    main()
