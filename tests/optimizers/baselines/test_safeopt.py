"""SafeOpt certifies, expands where its grid is dense, and says so where it does not."""

import numpy as np

from hdsafebo.optimizers.baselines.safeopt import SafeOpt, _View, _would_certify
from hdsafebo.problem import FunctionProblem
from optimizers.toy import bowl_problem, observe_initial, run_rounds


def line_problem() -> FunctionProblem:
    """One dimension; the maximum, 0.7, lies within the safe interval [0.2, 0.9]."""

    def function(x):
        return -((x[:, 0] - 0.7) ** 2), 2.0 * (0.35**2 - (x[:, 0] - 0.55) ** 2)

    return FunctionProblem(function, np.array([[0.0], [1.0]]), name="line")


def test_expands_from_a_seed_and_finds_the_optimum_safely_in_one_dimension() -> None:
    optimizer = SafeOpt(line_problem(), seed=0, grid=200)
    x = np.array([[0.0], [0.1], [0.45], [0.5], [1.0]])  # data from both sides, lest the amplitude be guessed
    optimizer.observe(x, *optimizer.problem.function(x), initial=True)
    run_rounds(optimizer, 25, 1)
    assert abs(optimizer.best().x[0] - 0.7) < 0.01
    assert optimizer.feasible[5:].mean() > 0.95
    certified = [entry["certified"] for entry in optimizer.expansion]
    assert certified[-1] > 1.5 * certified[0]
    assert max(entry["expanders"] for entry in optimizer.expansion) > 0


def test_reports_that_nothing_is_certified_in_high_dimension() -> None:
    problem = bowl_problem(dimension=60)
    problem.function = lambda x: (x.sum(axis=1), np.sin(40 * x).sum(axis=1))
    optimizer = SafeOpt(problem, seed=0, grid=100)
    observe_initial(optimizer, 30)
    trials = optimizer.ask(5)
    assert optimizer.expansion[-1]["certified"] == 0
    assert not trials.marked_unsafe.any()
    known = optimizer.trials.x[:30][optimizer.feasible[:30]]
    for x in trials.x:  # evaluated again: safe, and no progress
        assert np.abs(known - x).max(axis=1).min() < 1e-12


def test_expanders_are_those_whose_optimistic_outcome_certifies() -> None:
    """Against a refit with the optimistic outcome added as data."""
    optimizer = SafeOpt(line_problem(), seed=0)
    x = np.array([[0.4], [0.45], [0.5]])
    optimizer.observe(x, *optimizer.problem.function(x), initial=True)
    gp = optimizer.surrogate.safety[0]
    inside, outside = np.array([[0.55], [0.47]]), np.linspace(0.56, 0.8, 13)[:, None]
    found = _would_certify(gp, inside, outside, 0.0, 2.0)
    for i, point in enumerate(inside):
        mean, deviation = gp.predict(point[None])
        optimistic = (mean[0] + 2 * deviation[0] - gp.outcomes.centre) / gp.outcomes.scale
        inputs = np.vstack([gp.inputs, point])
        k = lambda a, b: gp.correlation(a) if b is None else _kernel(gp, a, b)  # noqa: E731
        covariance = k(inputs, inputs) + gp.hyper.noise_ratio * np.eye(len(inputs))
        weights = np.linalg.solve(covariance, np.append(gp.values, optimistic) - gp.mean)
        cross = k(outside, inputs)
        lower_mean = gp.outcomes.restore(gp.mean + cross @ weights)
        variance = 1.0 - np.einsum("ij,ji->i", cross, np.linalg.solve(covariance, cross.T))
        lower = lower_mean - 2 * gp.signal_deviation * np.sqrt(np.maximum(variance, 0))
        np.testing.assert_array_equal(found[i], lower >= 0.0)


def _kernel(gp, a, b):
    from hdsafebo.gp.kernel import fast_distances, matern52

    return matern52(fast_distances(a, b), gp.length_scale)


def test_believed_points_lose_their_variance() -> None:
    optimizer = SafeOpt(bowl_problem(), seed=0)
    observe_initial(optimizer, 20)
    points = np.random.default_rng(0).random((30, 4))
    view = _View.of(optimizer.surrogate.objective, points)
    before = view.variance.copy()
    view.believe(3)
    view.believe(7)
    ratio = view.gp.hyper.noise_ratio
    assert (view.variance <= before + 1e-12).all()
    assert view.variance[3] <= ratio * (1 + 1e-6) + 1e-9
    assert view.variance[7] <= ratio * (1 + 1e-6) + 1e-9
