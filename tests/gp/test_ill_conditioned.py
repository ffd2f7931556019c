"""Fits of data that no covariance likes: finite predictions, every rescue counted, or a clear error.

The noise of at least 1e-7 keeps a Matern covariance of real data factorisable. What the ladder is for, a
kernel matrix that rounding has made indefinite, is therefore made here: equal points whose correlation
exceeds one by `excess` have a covariance with the eigenvalue noise + jitter - excess.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from ill_conditioned import INPUTS, OUTCOMES, hard_inputs, hard_outcomes

from hdsafebo.errors import SurrogateError
from hdsafebo.gp import fit as gp_fit
from hdsafebo.gp.fit import fit_gaussian_process
from hdsafebo.gp.gaussian_process import GaussianProcess, Hyperparameters
from hdsafebo.gp.kernel import exact_distances, matern52
from hdsafebo.gp.surrogate import Surrogate, SurrogateState, fit_surrogate
from hdsafebo.optimizers.hdsafebo import HdSafeBO
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.typing import FloatArray

Patch = pytest.MonkeyPatch
BETAS = (-2.0, 2.0)


def round_up(patch: Patch, excess: float) -> None:
    """Let correlations be too large by a factor, as those of a kernel that was computed badly."""
    patch.setattr(gp_fit, "matern52", lambda r, length: (1.0 + excess) * matern52(r, length))


def rescued(gp: GaussianProcess) -> float:
    """How much the factorised diagonal exceeds 1 + noise, from the factor itself."""
    diagonal = np.einsum("ij,ij->i", gp.factor, gp.factor)
    return float(diagonal.max() - 1.0 - gp.hyper.noise_ratio)


def assert_finite(surrogate: Surrogate, x: FloatArray) -> None:
    """Everything that an optimiser may ask of a surrogate."""
    predictions = [*surrogate.objective.predict(x), *surrogate.predict_safety(x)]
    for values in (*predictions, surrogate.safe_probability(x), surrogate.violation_bound(x, None)):
        assert np.isfinite(values).all()
    for beta in BETAS:
        slack, gradient = surrogate.slack_with_gradient(x, beta)
        assert np.isfinite(slack).all()
        assert np.isfinite(gradient).all()
        assert (np.abs(slack - surrogate.slack(x, beta)) <= 1e-2 + 1e-3 * np.abs(slack)).all()
        np.testing.assert_array_equal(surrogate.believed_safe(x, beta), surrogate.slack(x, beta) >= 0)


def run_case(seed: int) -> Counter[str]:
    """Three fits of growing data; what happened to them."""
    rng = np.random.default_rng(seed)
    kind = INPUTS[seed % len(INPUTS)]
    n, p = int(rng.integers(3, 30)), int(rng.integers(1, 12))
    x = hard_inputs(rng, n, p, kind)
    objective, safety = (hard_outcomes(rng, x, name) for name in rng.choice(OUTCOMES, 2))
    threshold = np.array([float(rng.choice(safety))])
    excess = 10.0 ** rng.uniform(-9, 0) if rng.random() < 0.5 else 0.0
    state: SurrogateState | None = None
    counts: Counter[str] = Counter()
    with Patch.context() as patch:
        for k in (n // 3, 2 * n // 3, n):
            if state is not None:
                round_up(patch, excess)
            try:
                surrogate = fit_surrogate(x[:k], objective[:k], safety[:k, None], threshold, start=state)
            except SurrogateError:
                counts["refused"] += 1
                break
            before, state = state, surrogate.state
            step = np.std(x, axis=0) * rng.standard_normal((5, p))
            assert_finite(surrogate, np.vstack([x[:5], x[rng.integers(n, size=5)] + step]))
            starts = (None, None) if before is None else (before.objective, *before.safety)
            for gp, start in zip((surrogate.objective, *surrogate.safety), starts, strict=True):
                jittered = rescued(gp) > 1e-9
                assert gp.hyper.jitters == (start.jitters if start else 0) + jittered
                assert gp.hyper.fallbacks >= gp.hyper.jitters
                counts["rescued" if jittered else "fitted"] += 1
    return counts


def run_cases(seeds: range) -> Counter[str]:
    total: Counter[str] = Counter()
    for seed in seeds:
        total.update(run_case(seed))
    return total


@pytest.mark.thorough
def test_sixty_ill_conditioned_fits() -> None:
    counts = run_cases(range(60))
    assert min(counts["fitted"], counts["rescued"], counts["refused"]) > 0, counts


@pytest.mark.slow
def test_a_thousand_ill_conditioned_fits() -> None:
    counts = run_cases(range(1000))
    assert min(counts["fitted"] / 10, counts["rescued"], counts["refused"]) > 10, counts


# --- the rungs of the ladder


def equal_points() -> tuple[FloatArray, FloatArray, Hyperparameters]:
    """Distances of 12 equal points, their outcomes, and the hyper-parameters of a last good fit."""
    y = np.random.default_rng(0).standard_normal(12)
    return np.zeros((12, 12)), y, Hyperparameters(0.5, 1e-6, (0.1, 0.1), 5, 0.5, jitters=2, fallbacks=3)


@pytest.mark.parametrize(
    ("excess", "jitter"), [(1.2e-6, 1e-6), (3e-5, 1e-4), (3e-3, 1e-2), (1.0001e-6, 1e-8)]
)
def test_first_rung_the_least_jitter_that_suffices(monkeypatch: Patch, excess: float, jitter: float) -> None:
    distances, y, last = equal_points()
    round_up(monkeypatch, excess)
    monkeypatch.setattr(
        gp_fit._Search, "improve", lambda self, axis: 0.1
    )  # a step in noise would rescue, too
    gp = fit_gaussian_process(np.zeros((12, 2)), distances, y, start=last)
    assert rescued(gp) == pytest.approx(jitter, rel=1e-3)
    assert (gp.hyper.jitters, gp.hyper.fallbacks) == (3, 4)


def test_second_rung_the_last_good_hyper_parameters(monkeypatch: Patch) -> None:
    distances, y, last = equal_points()
    round_up(monkeypatch, 3e-3)
    gp = fit_gaussian_process(np.zeros((12, 2)), distances, y, start=last)
    assert gp.hyper.length_scale == pytest.approx(last.length_scale, rel=1e-12)
    assert gp.hyper.noise_ratio == pytest.approx(last.noise_ratio, rel=1e-12)
    assert (gp.hyper.fits, gp.hyper.fallbacks) == (6, 4)
    mean, deviation = gp.predict(np.array([[0.0, 0.0], [9.0, 9.0]]))
    assert np.isfinite(mean).all()
    assert 0 < deviation[0] < deviation[1]


def test_third_rung_abstention(monkeypatch: Patch) -> None:
    """No trial is proposed, nothing is consumed, and the optimiser goes on once a fit succeeds."""
    bounds = np.array([[0.0, 0.0], [1.0, 1.0]])
    problem = FunctionProblem(lambda x: (x[:, 0], x[:, 1]), bounds, [Safety("g", 0.2)])
    optimizers = [HdSafeBO(problem, seed=3, candidates=64) for _ in range(2)]
    for made in optimizers:
        made.observe(np.full((6, 2), 0.5), np.ones(6), np.ones(6), initial=True)
    with monkeypatch.context() as patch:
        round_up(patch, 2.0)
        with pytest.raises(SurrogateError, match=r"6 points has no Cholesky factor .* not even with jitter"):
            optimizers[0].ask(2)
    assert len(optimizers[0].trials) == 6
    np.testing.assert_array_equal(optimizers[0].ask(2).x, optimizers[1].ask(2).x)


# --- limits of floating point


@pytest.mark.parametrize("offset", [1e6, 1e8])
def test_data_far_from_the_origin_are_predicted_as_if_near(offset: float) -> None:
    """Distances by one matrix product lose all digits there."""
    rng = np.random.default_rng(1)
    step = 2.0**-10  # exact at every offset
    x = step * rng.integers(0, 1000, (40, 3))
    y = np.sin(4 * x).sum(axis=1)
    near, far = (fit_gaussian_process(x + a, exact_distances(x, x), y) for a in (0.0, offset))
    q = step * rng.integers(0, 1000, (30, 3))
    for one, other in zip(near.predict_with_gradient(q), far.predict_with_gradient(q + offset), strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(far.predict(q + offset), near.predict(q), rtol=1e-3, atol=1e-4)


def test_inputs_without_finite_distances_are_refused() -> None:
    x = np.array([[0.0], [1e200], [-1e200]])
    with pytest.raises(SurrogateError, match="distances between the kernel inputs of 3 trials"):
        fit_surrogate(x, np.ones(3), np.ones((3, 1)), np.zeros(1))


@pytest.mark.parametrize("largest", [1e150, 1.7e308])
def test_outcomes_whose_squares_overflow_are_drawn_in(largest: float) -> None:
    x = np.random.default_rng(2).random((3, 2))
    surrogate = fit_surrogate(x, np.array([0.0, largest, -largest]), np.ones((3, 1)), np.zeros(1))
    assert_finite(surrogate, x)
    mean = surrogate.objective.predict(x)[0]
    assert mean[2] < mean[0] < mean[1]
