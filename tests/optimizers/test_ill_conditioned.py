"""Whatever data an optimiser is told, what it proposes was believed safe or is marked; never in silence."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from ill_conditioned import INPUTS, OUTCOMES, hard_inputs, hard_outcomes

from hdsafebo.errors import NoSafePointError, SurrogateError
from hdsafebo.gp.warped_surrogate import WarpedSurrogate
from hdsafebo.optimizers.base import Optimizer
from hdsafebo.optimizers.registry import make_optimizer
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.trials import Trials
from optimizers.toy import Rows

METHODS = ("hdsafebo", "hdsafebo_local", "hdsafebo_local on rows", "config", "linebo")
ROUNDS = 3
BATCH = 4


def hard_optimizer(seed: int) -> Optimizer:
    """An optimiser that was told hard data."""
    rng = np.random.default_rng([seed, 0])
    n, d = int(rng.integers(2, 25)), int(rng.integers(1, 8))
    x = hard_inputs(rng, n, d, INPUTS[seed % len(INPUTS)])
    objective, safety = (hard_outcomes(rng, x, kind) for kind in rng.choice(OUTCOMES, 2))
    method, _, on_rows = METHODS[seed % len(METHODS)].partition(" ")
    lower, upper = x.min(axis=0), x.max(axis=0)
    bounds = np.stack([lower, np.where(upper > lower, upper, lower + np.maximum(np.abs(lower), 1.0))])
    problem = FunctionProblem(lambda q: (q[:, 0], q[:, 0]), bounds, [Safety("g", float(rng.choice(safety)))])
    if on_rows:
        problem.candidates = Rows(np.vstack([x, hard_inputs(rng, 200, d, INPUTS[seed % len(INPUTS)])]))
    policy = ("mark", "abstain")[rng.integers(2)]
    alpha = float(rng.choice([0.05, 0.5, 0.95, 0.999]))
    made = make_optimizer(method, problem, seed=seed, alpha=alpha, empty_safe_set=policy)
    made.observe(x, objective, safety, candidate=np.arange(n) if on_rows else None, initial=True)
    return made


def check_believed_safe_or_marked(optimizer: Optimizer, trials: Trials) -> None:
    """Every proposal, by the closed form of the bound at the point that will be evaluated."""
    surrogate, beta = optimizer.surrogate, optimizer.settings.confidence
    mean, deviation = surrogate.predict_safety(optimizer.kernel_inputs(trials))
    assert np.isfinite(mean).all()
    assert (deviation > 0).all()
    assert np.isfinite(deviation).all()
    for column in ("x", "z", "predicted_safe_probability", "violation_bound"):
        assert np.isfinite(getattr(trials, column)).all(), column
    if isinstance(surrogate, WarpedSurrogate):  # whose bounds are those of warped values
        slack = surrogate.slack(optimizer.kernel_inputs(trials), beta)[:, None]
    else:
        scale = [g.signal_deviation for g in surrogate.safety]
        slack = (mean + beta * deviation - surrogate.thresholds) / scale
    # Far from zero a proposed point is rounded, by more than nothing in units of the length scale.
    rounding = np.finfo(float).eps * np.abs(trials.z).max(axis=1) / optimizer.space.width.max()
    tolerance = 1e-3 + 20 * rounding / surrogate.length_scale
    unfiltered = ~trials.marked_unsafe & (slack.min(axis=1) < -tolerance)
    assert not unfiltered.any(), slack[unfiltered]


def told_hard_results(optimizer: Optimizer, trials: Trials, rng: np.random.Generator) -> None:
    kinds = rng.choice(OUTCOMES, 2)
    optimizer.tell(trials, *(hard_outcomes(rng, trials.x, kind) for kind in kinds))


def run_case(seed: int) -> str:
    """How a short run on hard data ends."""
    rng = np.random.default_rng([seed, 1])
    optimizer = hard_optimizer(seed)
    for _ in range(ROUNDS):
        try:
            trials = optimizer.ask(BATCH)
        except (NoSafePointError, SurrogateError) as error:
            return type(error).__name__
        check_believed_safe_or_marked(optimizer, trials)
        told_hard_results(optimizer, trials, rng)
    return "marked" if optimizer.trials.marked_unsafe.any() else "safe"


@pytest.mark.thorough
def test_twenty_runs_on_hard_data() -> None:  # the slow test has a thousand
    ends = Counter(run_case(seed) for seed in range(20))
    assert ends["safe"] > 0


@pytest.mark.slow
def test_a_thousand_runs_on_hard_data() -> None:
    ends = Counter(run_case(seed) for seed in range(1000))
    assert min(ends["safe"], ends["marked"], ends["NoSafePointError"]) > 50, ends
