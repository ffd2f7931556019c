"""Are predicted safe probabilities what they say, when the assumptions hold?

Problems are drawn from the model itself: objective and safety are sample paths of the Matern-5/2 process,
observed with noise. `hdsafebo` runs on each, one trial a round, with the beta of a wanted alpha. What was
predicted when a trial was asked is compared with whether its safety function, free of noise, meets the
threshold.

With the hyper-parameters given, the prediction is the conditional probability given all that was told
before, so the differences of outcome and prediction are a martingale and add up like independent ones, though
the trials were chosen by the data: every bin must hold its mean prediction within the binomial interval. A
batch of several trials would share what it did not know, hence one trial a round. With the hyper-parameters
fitted, which is how the methods are used, nothing is promised; what comes out is measured.

    python benchmarks/calibration.py --write
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.linalg import solve_triangular
from scipy.stats import binomtest

from hdsafebo.files.atomic import write_json
from hdsafebo.gp.gaussian_process import GaussianProcess, Hyperparameters
from hdsafebo.gp.kernel import exact_distances, matern52
from hdsafebo.gp.outcomes import Outcomes
from hdsafebo.gp.safe_set import alpha_of
from hdsafebo.gp.surrogate import Surrogate
from hdsafebo.optimizers.hdsafebo import HdSafeBO
from hdsafebo.problem import Problem, Safety
from hdsafebo.problems.gaussian_path import GaussianPath
from hdsafebo.trials import Evaluation, Trials
from hdsafebo.typing import FloatArray

OUTPUT = Path(__file__).parents[1] / "reports" / "reference" / "benchmarks" / "calibration.json"
ALPHAS = (alpha_of(2.0), 0.5, 0.8, 0.95)
"""Of the paper's beta = 2, whose trials reach into all bins, and three that a user may ask for."""
DIMENSION = 6
LENGTH_SCALE = 0.8
NOISE = 1e-3
THRESHOLD = 0.0
INITIAL = 20
BINS = 10
CONFIDENCE = 0.99


class Drawn(Problem):
    """Objective and safety drawn from the model.

    Attributes:
        safety_values: of all evaluated trials, without noise.
    """

    def __init__(self, seed: int) -> None:
        objective, safety, self._noise = np.random.default_rng(seed).spawn(3)
        self.name = "drawn"
        self.bounds = np.stack([np.zeros(DIMENSION), np.ones(DIMENSION)])
        self.safety = (Safety("safety", THRESHOLD),)
        self._objective = GaussianPath(DIMENSION, LENGTH_SCALE, 0.0, objective)
        self._safety = GaussianPath(DIMENSION, LENGTH_SCALE, 0.0, safety)
        self.safety_values = np.empty(0)

    def evaluate(self, trials: Trials) -> Evaluation:
        """Both with noise."""
        objective, safety = self._objective(trials.x), self._safety(trials.x)
        self.safety_values = np.append(self.safety_values, safety)
        noise = np.sqrt(NOISE) * self._noise.standard_normal((2, len(trials)))
        return Evaluation(objective + noise[0], (safety + noise[1])[:, None])


def given_process(inputs: FloatArray, y: FloatArray) -> GaussianProcess:
    """The posterior with the hyper-parameters that the problem was drawn with."""
    covariance = matern52(exact_distances(inputs, inputs), LENGTH_SCALE) + NOISE * np.eye(len(y))
    factor = np.linalg.cholesky(covariance)
    weights = solve_triangular(factor, solve_triangular(factor, y, lower=True), lower=True, trans=1)
    hyper = Hyperparameters(LENGTH_SCALE, NOISE, (0.1, 0.1), 1, LENGTH_SCALE)
    return GaussianProcess(inputs, y, Outcomes(0.0, 1.0), hyper, 0.0, 1.0, factor, weights)


def given_surrogate(
    inputs: FloatArray, objective: FloatArray, safety: FloatArray, thresholds: FloatArray, **_: Any
) -> Surrogate:
    """In place of `surrogate.fit_surrogate`."""
    processes = tuple(given_process(inputs, y) for y in safety.T)
    return Surrogate(given_process(inputs, objective), processes, thresholds)


@dataclass
class Asked:
    """Asked trials: predicted safe probability, whether they were safe, and whether they were marked."""

    predicted: list[float] = field(default_factory=list)
    safe: list[bool] = field(default_factory=list)
    marked: list[bool] = field(default_factory=list)


def ask_on(seed: int, alpha: float, rounds: int, asked: Asked) -> None:
    """One problem."""
    problem = Drawn(seed)
    optimizer = HdSafeBO(problem, seed=seed, alpha=alpha, candidates=128, empty_safe_set="mark")
    x, _ = problem.initial(INITIAL, np.random.default_rng([seed, 1]))
    first = problem.evaluate(Trials.pending(x, x, 1))
    optimizer.observe(x, first.objective, first.safety, initial=True)
    for _ in range(rounds):
        trials = optimizer.ask(1)
        results = problem.evaluate(trials)
        optimizer.tell(trials, results.objective, results.safety)
    chosen = optimizer.trials[INITIAL:]
    asked.predicted += chosen.predicted_safe_probability.tolist()
    asked.safe += (problem.safety_values[INITIAL:] >= THRESHOLD).tolist()
    asked.marked += chosen.marked_unsafe.tolist()


def ask_all(seeds: range, alpha: float, rounds: int, *, given: bool) -> Asked:
    """All problems, with hyper-parameters given or fitted."""
    asked = Asked()
    for seed in seeds:
        if given:
            with patch("hdsafebo.optimizers.core.fits.fit_surrogate", given_surrogate):
                ask_on(seed, alpha, rounds, asked)
        else:
            ask_on(seed, alpha, rounds, asked)
    return asked


def interval(safe: np.ndarray) -> tuple[float, float]:
    """Exact binomial limits of the safe share behind (n,) outcomes."""
    limits = binomtest(int(safe.sum()), len(safe)).proportion_ci(CONFIDENCE, "exact")
    return float(limits.low), float(limits.high)


def calibration(asked: Asked, alpha: float) -> dict[str, Any]:
    """Ten bins of predicted probability, and the share of safe trials among those believed safe."""
    p, safe = np.array(asked.predicted), np.array(asked.safe)
    index = np.minimum((p * BINS).astype(int), BINS - 1)
    bins = []
    for b in np.unique(index):
        inside = index == b
        low, high = interval(safe[inside])
        predicted = float(p[inside].mean())
        bins.append(
            {
                "low": b / BINS,
                "high": (b + 1) / BINS,
                "trials": int(inside.sum()),
                "predicted": predicted,
                "observed": float(safe[inside].mean()),
                "observed_low": low,
                "observed_high": high,
                "within": low <= predicted <= high,
            }
        )
    believed = safe[~np.array(asked.marked)]
    low, high = interval(believed)
    return {
        "alpha": alpha,
        "bins": bins,
        "trials": len(p),
        "marked": int(len(p) - len(believed)),
        "predicted": float(p.mean()),
        "safe_share_believed": float(believed.mean()),
        "safe_share_low": low,
        "safe_share_high": high,
        "alpha_kept": high >= alpha,
    }


def main() -> None:
    """Given and fitted hyper-parameters at every alpha."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--problems", type=int, default=200, help="default: 200")
    parser.add_argument("--rounds", type=int, default=5, help="trials asked on each problem (default: 5)")
    parser.add_argument("--first-seed", type=int, default=1000, help="default: 1000")
    parser.add_argument("--write", action="store_true", help=f"write {OUTPUT.name} to reports/reference")
    arguments = parser.parse_args()
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.problems)
    result: dict[str, Any] = {"problems": arguments.problems, "rounds": arguments.rounds}
    for name, given in (("given", True), ("fitted", False)):
        result[name] = []
        for alpha in ALPHAS:
            table = calibration(ask_all(seeds, alpha, arguments.rounds, given=given), alpha)
            result[name].append(table)
            outside = [b for b in table["bins"] if not b["within"]]
            print(
                f"{name:6s} alpha {alpha:.3f}: predicted {table['predicted']:.3f}, "
                f"believed safe and safe {table['safe_share_believed']:.3f} [{table['safe_share_low']:.3f}, "
                f"{table['safe_share_high']:.3f}], {table['marked']} of {table['trials']} marked, "
                f"{len(outside)} of {len(table['bins'])} bins outside: "
                + "; ".join(f"{b['predicted']:.3f} observed {b['observed']:.3f}" for b in outside),
                flush=True,
            )
    if arguments.write:
        OUTPUT.parent.mkdir(parents=True, exist_ok=True)
        write_json(OUTPUT, result, sort_keys=True)


if __name__ == "__main__":
    main()
