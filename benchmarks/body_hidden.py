"""What CMA-ES over all weights of the body changes: what the kernel sees of policies, or what it hides?

Of every seed's run, the change from the best safe reflex to the best safe policy is split into the shortest
change of the weights that the features show, and the rest, which they hide; and the rest into what it does in
joint torques, and what it does beside them. Each part is added to the reflex alone and played, beside random
changes of the hidden part's size. It reads the run file of the stage (`python stages/optimize.py body
cmaes_tuned`, profile reference) and writes `body_hidden.json`; 120 episodes, about three minutes.

    python benchmarks/body_hidden.py --write
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import numpy as np  # noqa: E402  (after the thread limits)

from hdsafebo.bodies.posture import posture_of  # noqa: E402
from hdsafebo.files.atomic import write_json  # noqa: E402
from hdsafebo.params import load_params  # noqa: E402
from hdsafebo.policies import GymnasiumPolicies  # noqa: E402
from hdsafebo.problems.body import RECORDED_FILE, load_observations, policies_of  # noqa: E402
from hdsafebo.runs.best_trial import best_trials  # noqa: E402
from hdsafebo.trials import Trials  # noqa: E402
from hdsafebo.typing import FloatArray  # noqa: E402

ROOT = Path(__file__).parents[1]
RUN = Path("data/runs/body-cmaes_tuned.parquet")
OUT = ROOT / "reports" / "reference" / "benchmarks" / "body_hidden.json"
RANDOM = 3
_SMALL = 1e-3
"""Singular values of torques per excitation below it, in units of the largest, are no effect."""


def parts(policies: GymnasiumPolicies, body: str, change: FloatArray) -> dict[str, FloatArray]:
    """Parts of the (D,) change of a policy, by name."""
    low, high = policies.bounds
    width = high - low
    seen = policies.features.matrix * width
    visible = np.linalg.pinv(seen) @ (seen @ (change / width)) * width
    hidden = change - visible
    torques = posture_of(body).torque.T
    effect = np.linalg.pinv(torques, rcond=_SMALL) @ torques
    in_torques = (effect @ hidden.reshape(len(effect), -1)).ravel()
    return {
        "whole": change,
        "visible": visible,
        "hidden": hidden,
        "hidden, in joint torques": in_torques,
        "hidden, beside them": hidden - in_torques,
    }


def returns(policies: GymnasiumPolicies, reflex: FloatArray, changes: list[FloatArray]) -> list[float]:
    """Return of a reflex with each change."""
    low, high = policies.bounds
    x = np.clip(reflex + np.stack(changes), low, high)
    results = policies.evaluate(Trials.pending(x, x, len(policies.safety)))
    return [round(float(value), 1) for value in results.objective]


def main() -> None:
    """Play the parts of every seed, and keep the returns."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--root", type=Path, default=ROOT, help="project whose run is read (default: this)")
    parser.add_argument("--write", action="store_true", help=f"keep the result in {OUT.name}")
    given = parser.parse_args()
    settings = load_params(given.root / "params.yaml").tasks.body.problem
    policies = policies_of(settings, load_observations(given.root / RECORDED_FILE))
    reflexes = {trial.seed: trial for trial in best_trials(given.root / RUN, initial=True)}
    low, high = policies.bounds
    rows = []
    for best in best_trials(given.root / RUN):
        reflex = reflexes[best.seed]
        found = parts(policies, settings.body, best.z - reflex.z)
        deviation = (found["hidden"] / (high - low)).std()
        rng = np.random.default_rng(best.seed)
        random = [rng.standard_normal(len(low)) * deviation * (high - low) for _ in range(RANDOM)]
        played = returns(policies, reflex.z, [*found.values(), *random])
        row = {"seed": best.seed, "reflex": round(reflex.objective, 1)}
        row |= dict(zip(found, played, strict=False))
        rows.append(
            row | {"random": played[len(found) :], "hidden deviation, in boxes": round(float(deviation), 5)}
        )
        print(json.dumps(rows[-1]), flush=True)
    if given.write:
        write_json(OUT, rows)


if __name__ == "__main__":
    main()
