"""Speed of the hand: physics, evaluations of policies, and two evaluations at once.

Times are CPU seconds of one core, except those of the parallel evaluation, which are wall clock and mean
something on an idle machine only.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path
from statistics import median

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import numpy as np  # noqa: E402  (after the thread limits)

from hdsafebo.campaign.executor import process_pool  # noqa: E402
from hdsafebo.files.atomic import write_json  # noqa: E402
from hdsafebo.hand.policy import LinearPolicySpace  # noqa: E402
from hdsafebo.hand.rollout import Scene, evaluate_policies  # noqa: E402

TARGET_S = 0.25
TARGET_RATIO = 0.6


def main() -> None:
    """Measure both hands and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policies", type=int, default=24, help="policies per hand (default: 24)")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    arguments = parser.parse_args()
    found = {variant: measure(variant, arguments.policies) for variant in ("forearm", "extended")}
    print(f"{'':34}" + "".join(f"{variant:>12}" for variant in found))
    for key in next(iter(found.values())):
        print(f"{key:34}" + "".join(f"{row[key]:12.3f}" for row in found.values()))
    print(f"targets: evaluation at most {TARGET_S} s (43 muscles), two at once at most {TARGET_RATIO}")
    if arguments.json:
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        write_json(arguments.json, found)


def measure(variant: str, policies: int) -> dict[str, float]:
    """Times of one hand on random policies."""
    scene = Scene(variant)
    start = time.process_time()
    simulation = scene.simulation()
    build = time.process_time() - start
    space = LinearPolicySpace.original(simulation.pose.activation, simulation.observer.size)
    parameters = np.random.default_rng(0).uniform(-0.05, 0.05, (policies, space.dimension))
    seconds, steps = [], []
    for policy in parameters:
        start = time.process_time()
        episodes = evaluate_policies(scene, space, policy[None])
        seconds.append(time.process_time() - start)
        steps.append(int(episodes.steps[0]))
    start = time.perf_counter()
    evaluate_policies(scene, space, parameters)
    alone = time.perf_counter() - start
    with process_pool(2) as executor:
        evaluate_policies(scene, space, parameters[:4], executor)  # workers build their models
        start = time.perf_counter()
        evaluate_policies(scene, space, parameters, executor)
        together = time.perf_counter() - start
    return {
        "build and start pose, CPU s": build,
        "evaluation, CPU s (median)": median(seconds),
        "control steps per CPU s": sum(steps) / sum(seconds),
        "two at once / one by one (wall)": together / alone,
    }


if __name__ == "__main__":
    main()
