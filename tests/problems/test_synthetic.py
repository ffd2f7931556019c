"""The synthetic task: geometry, reproducibility, and its closed-form random search."""

import numpy as np
import pytest
from scipy.stats import norm

from hdsafebo.optimizers.registry import make_optimizer
from hdsafebo.problems.synthetic import SyntheticProblem, pca_of_initial
from hdsafebo.trials import Trials

SMALL = {"dimension": 30, "latent_dimension": 6, "effective_dimension": 4}


def evaluated(problem: SyntheticProblem, x: np.ndarray):
    return problem.evaluate(Trials.pending(x, x, 1))


def test_initial_inputs_have_uniform_latent_points_within_the_box() -> None:
    problem = SyntheticProblem(0)
    x, rows = problem.initial(200, np.random.default_rng(0))
    latent = x @ problem.projection
    assert x.shape == (200, 1000)
    assert (rows == -1).all()
    assert latent.min() >= -1e-9
    assert latent.max() <= 1 + 1e-9
    np.testing.assert_allclose(latent.mean(), 0.5, atol=0.01)
    np.testing.assert_allclose(latent.var(), 1 / 12, rtol=0.03)
    assert ((x >= problem.bounds[0]) & (x <= problem.bounds[1])).all()
    assert np.linalg.matrix_rank(x - x.mean(axis=0)) == 50


def test_pca_is_an_isometry_on_what_matters() -> None:
    problem = SyntheticProblem(1)
    x, _ = problem.initial(200, np.random.default_rng(1))
    pca = pca_of_initial(50)(x)
    z = np.random.default_rng(2).standard_normal((30, 50)) * 0.2 + pca.encode(x[:1])
    points = pca.decode(z)
    np.testing.assert_allclose(pca.encode(points), z, atol=1e-10)
    distances = [np.linalg.norm(a[:, None] - a[None], axis=2) for a in (z, points)]
    np.testing.assert_allclose(*distances, atol=1e-10)


def test_effective_coordinates() -> None:
    assert len(set(SyntheticProblem(3).effective.tolist())) == 40
    assert len(set(SyntheticProblem(3, with_replacement=True).effective.tolist())) < 40


def test_values_depend_on_effective_coordinates_alone() -> None:
    problem = SyntheticProblem(4, **SMALL, noise_variance=0.0)
    x, _ = problem.initial(1, np.random.default_rng(0))
    silent = np.setdiff1d(np.arange(6), problem.effective)
    moved = x + 0.3 * np.linalg.pinv(problem.projection)[silent[0]]
    result = evaluated(problem, np.vstack([x, moved]))
    np.testing.assert_allclose(result.objective[0], result.objective[1], atol=1e-5)
    np.testing.assert_allclose(result.safety[0], result.safety[1], atol=1e-5)


def test_seed_and_history_decide_the_values() -> None:
    x, _ = SyntheticProblem(5, **SMALL).initial(8, np.random.default_rng(0))
    whole = evaluated(SyntheticProblem(5, **SMALL), x)
    parts = SyntheticProblem(5, **SMALL)
    first, second = evaluated(parts, x[:3]), evaluated(parts, x[3:])
    np.testing.assert_array_equal(whole.objective, np.append(first.objective, second.objective))
    np.testing.assert_array_equal(whole.safety[:, 0], np.append(first.safety, second.safety))
    assert not np.array_equal(whole.objective, evaluated(SyntheticProblem(6, **SMALL), x).objective)


def test_objective_and_safety_are_unrelated() -> None:
    x, _ = SyntheticProblem(7).initial(300, np.random.default_rng(0))
    result = evaluated(SyntheticProblem(7), x)
    assert abs(np.corrcoef(result.objective, result.safety[:, 0])[0, 1]) < 4 / np.sqrt(300)


def test_local_variant_on_a_small_task() -> None:
    problem = SyntheticProblem(8, **SMALL, length_scale=0.3)
    x, _ = problem.initial(40, np.random.default_rng(0))
    optimizer = make_optimizer("hdsafebo_local", problem, embedding=pca_of_initial(6)(x), seed=0)
    result = evaluated(problem, x)
    optimizer.observe(x, result.objective, result.safety, initial=True)
    start = optimizer.best().objective
    for _ in range(8):
        trials = optimizer.ask(5)
        result = problem.evaluate(trials)
        optimizer.tell(trials, result.objective, result.safety)
    asked = optimizer.trials[optimizer.trials.round > 0]
    assert optimizer.best().objective > start + 0.3
    assert problem.is_safe(asked.safety).mean() > 0.9


@pytest.mark.slow
def test_random_search_has_its_closed_form() -> None:
    """Far points are independent: Safety = Phi(-h), Violation = 300 (phi(h) + h Phi(h))."""
    pytest.importorskip("hdsafebo.optimizers.controls.sobol")
    safety, violation = [], []
    for seed in range(1000, 1100):
        problem = SyntheticProblem(seed)
        x, _ = problem.initial(200, np.random.default_rng(seed))
        result = evaluated(problem, x)
        optimizer = make_optimizer("sobol", problem, embedding=pca_of_initial(50)(x), seed=seed)
        optimizer.observe(x, result.objective, result.safety, initial=True)
        for _ in range(30):
            trials = optimizer.ask(10)
            result = problem.evaluate(trials)
            optimizer.tell(trials, result.objective, result.safety)
        asked = optimizer.trials[optimizer.trials.round > 0]
        safety.append(problem.is_safe(asked.safety).mean())
        violation.append(problem.violation(asked.safety).sum())
    h = -0.75
    for values, expected in ((safety, norm.sf(h)), (violation, 300 * (norm.pdf(h) + h * norm.cdf(h)))):
        error = np.std(values, ddof=1) / np.sqrt(len(values))
        assert abs(np.mean(values) - expected) < 3 * error
