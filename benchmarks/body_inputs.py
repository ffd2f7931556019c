"""What can be known of a pushed body beforehand: how much of its outcomes do kernel inputs explain?

Reflexes are played with the evaluation pushes as the task draws them, and again with a little noise in all
their weights, as a step in all weights at once would give them. A Gaussian process predicts each reflex from
all others, with a length scale per input where these are few. Shown is the share of the variance that is
explained, 0 for no more than the mean: of the mean return, the shortest time until the fall, the largest
joint load over 0.1 s, and its peak. The inputs that are compared:

    features     the task's kernel inputs
    excitations  all excitations at all recorded observations
    torques      the joint torques that these excitations have at the posture
    gains        the seven gains themselves, which no other input can beat where nothing else differs

Beside them, of the episodes: when the joint load is largest, whether a body that leans comes back, and
whether who stands longer gets the higher return.

    python benchmarks/body_inputs.py --write
"""

from __future__ import annotations

import argparse
import json
import os
import warnings
from concurrent.futures import Executor
from dataclasses import astuple
from pathlib import Path
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import numpy as np  # noqa: E402  (after the thread limits)
from scipy.spatial.distance import pdist  # noqa: E402
from scipy.stats import spearmanr  # noqa: E402
from sklearn.exceptions import ConvergenceWarning  # noqa: E402
from sklearn.gaussian_process import GaussianProcessRegressor  # noqa: E402
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel  # noqa: E402

from hdsafebo.bodies.posture import posture_of  # noqa: E402
from hdsafebo.bodies.reflex import random_gains  # noqa: E402
from hdsafebo.bodies.simulation import CONTROL_INTERVAL  # noqa: E402
from hdsafebo.campaign.executor import process_pool  # noqa: E402
from hdsafebo.files.atomic import write_json  # noqa: E402
from hdsafebo.policies import GymnasiumPolicies  # noqa: E402
from hdsafebo.policies.episode import Episode  # noqa: E402
from hdsafebo.problems.body import body_policies, sustained  # noqa: E402
from hdsafebo.problems.reflexes import ReflexGainsProblem  # noqa: E402
from hdsafebo.typing import FloatArray  # noqa: E402

OUT = Path(__file__).parents[1] / "reports" / "reference" / "benchmarks" / "body_inputs.json"
BODY = "myofullbody"
REFLEXES = 40
SEED = 0
NOISE = 0.01
"""Length of the noise in the weights of one muscle, in excitations."""
TONE = 0.2
"""Deviation of the logarithm of the excitations at rest."""
FEW = 10
"""Inputs, up to which each has a length scale of its own."""
LATE = 0.3
"""s before the end of an episode that count as its fall."""
LEAN = 0.15
"""rad."""
BACK = 0.6
"""Share of `LEAN` under which a body has come back."""
_STARTS = 4
_JITTER = 1e-5
"""Least noise variance of standardised outcomes."""


def drawn(policies: GymnasiumPolicies) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Reflexes (n, D) as the task draws them, the same with noise in all weights, and their (n, 7) gains."""
    rng = np.random.default_rng(SEED)
    gains = np.array([astuple(gain) for gain in random_gains(BODY, REFLEXES, rng)])
    problem = ReflexGainsProblem(policies, BODY)
    exact = np.array([problem.weights(row) for row in gains])
    columns = policies.policies.observations + 1
    noise = NOISE / np.sqrt(columns) * rng.standard_normal(exact.shape)
    holding = posture_of(BODY).holding
    tone = holding * (np.exp(TONE * rng.standard_normal((REFLEXES, len(holding)))) - 1.0)
    noise.reshape(REFLEXES, -1, columns)[:, :, -1] += tone
    return exact, exact + noise, gains


def behaviour(policies: GymnasiumPolicies, x: FloatArray, effect: FloatArray) -> FloatArray:
    """(n, k * o) vectors whose distances are root mean squares of `effect` times the actions' differences.

    Args:
        policies: with the recorded observations that the mean is over.
        x: (n, D) weights.
        effect: (k, actions).
    """
    seen = policies.recorded
    values, vectors = np.linalg.eigh(seen.T @ seen / len(seen))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    weights = x.reshape(len(x), effect.shape[1], -1)
    return np.asarray(np.einsum("ka,nao->nko", effect, weights @ root).reshape(len(x), -1))


def explained(inputs: FloatArray, values: FloatArray) -> float:
    """Share of the variance of (n,) values that leave-one-out predictions explain."""
    few = inputs.shape[1] <= FEW
    scaled = inputs / (inputs.std(axis=0) if few else np.median(pdist(inputs)))
    standard = (values - values.mean()) / values.std()
    lengths = np.ones(inputs.shape[1] if few else 1)
    kernel = ConstantKernel(1.0, (1e-3, 1e3)) * Matern(lengths, (0.05, 100.0), nu=2.5)
    kernel += WhiteKernel(0.1, (_JITTER, 10.0))
    model = GaussianProcessRegressor(kernel, n_restarts_optimizer=_STARTS, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a length scale at its limit is an answer
        model.fit(scaled, standard)
    inverse = np.linalg.inv(model.kernel_(scaled))
    errors = inverse @ standard / np.diag(inverse)
    return float(1.0 - np.mean(errors**2))


def outcomes(episodes: list[list[Episode]]) -> dict[str, FloatArray]:
    """(n,) of policies that were played with every push."""
    return {
        "return": np.array([np.mean([e.total_reward for e in row]) for row in episodes]),
        "time": np.array([min(e.steps for e in row) * CONTROL_INTERVAL for row in episodes]),
        "load": np.array([max(sustained(load_of(e)) for e in row) for row in episodes]),
        "peak": np.array([max(load_of(e).max() for e in row) for row in episodes]),
    }


def load_of(episode: Episode) -> FloatArray:
    """(steps,) joint load, N m."""
    return np.array([info["joint_load"] for info in episode.infos])


def course(episodes: list[Episode]) -> dict[str, float]:
    """What the episodes have in common."""
    late = round(LATE / CONTROL_INTERVAL)
    tilts = [np.array([info["tilt"] for info in e.infos]) for e in episodes]
    leaning = [tilt[np.argmax(tilt > LEAN) :] for tilt in tilts if (tilt > LEAN).any()]
    return {
        "episodes": len(episodes),
        "fallen": sum(e.terminated for e in episodes),
        "largest_load_while_falling": sum(bool(load_of(e).argmax() >= e.steps - late) for e in episodes),
        "leaned": len(leaning),
        "came_back": sum(bool((tilt < BACK * LEAN).any()) for tilt in leaning),
        "negative_return": sum(e.total_reward < 0.0 for e in episodes),
        "rank_correlation_of_time_and_return": float(
            spearmanr([e.steps for e in episodes], [e.total_reward for e in episodes]).statistic
        ),
    }


def measured(executor: Executor) -> dict[str, Any]:
    """All of it."""
    policies = body_policies(BODY, executor=executor)
    exact, noisy, gains = drawn(policies)
    posture = posture_of(BODY)
    found: dict[str, Any] = {"reflexes": REFLEXES, "seed": SEED}
    for name, x in (("as_drawn", exact), ("with_noise", noisy)):
        played = [policies.play(row) for row in x]
        inputs = {
            "features": policies.features(x),
            "excitations": behaviour(policies, x, np.eye(len(posture.holding))),
            "torques": behaviour(policies, x, posture.torque.T),
            "gains": (gains - gains.min(axis=0)) / np.ptp(gains, axis=0),
        }
        values = outcomes(played)
        found[name] = {
            "explained": {i: {v: explained(inputs[i], values[v]) for v in values} for i in inputs},
            "median_time_s": float(np.median(values["time"])),
            "best_return": float(values["return"].max()),
            "course": course([e for row in played for e in row]),
        }
    return found


def main() -> None:
    """Play, print, and keep the result if wanted."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--workers", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--write", action="store_true", help=f"keep the result in {OUT.name}")
    given = parser.parse_args()
    with process_pool(given.workers) as executor:
        found = measured(executor)
    print(json.dumps(found, indent=1))
    if given.write:
        write_json(OUT, found)


if __name__ == "__main__":
    main()
