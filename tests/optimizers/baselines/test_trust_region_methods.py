"""TuRBO, SCBO and BAxUS: the region's rule, restarts, and what they reach."""

import numpy as np
import pytest

from hdsafebo.gp.sampling import distinct_maxima
from hdsafebo.optimizers.baselines.baxus import Baxus, nesting
from hdsafebo.optimizers.baselines.box_region import box_rule, failure_tolerance, relative_weights
from hdsafebo.optimizers.baselines.hesbo import Hesbo
from hdsafebo.optimizers.baselines.scbo import Scbo, bilog, feasible_first
from hdsafebo.optimizers.baselines.turbo import Turbo
from hdsafebo.problem import FunctionProblem
from hdsafebo.search.candidates import box_candidates
from hdsafebo.search.region import TrustRegion, safe_update
from optimizers.toy import bowl_problem, observe_initial, run_rounds

RULE = box_rule(successes=2, failures=2)


def test_side_doubles_and_halves() -> None:
    region = TrustRegion(0.8)
    for success, length in ((True, 0.8), (True, 1.6), (True, 1.6), (False, 1.6), (True, 1.6), (True, 1.6)):
        region = safe_update(region, success, RULE)
        assert region.length == length
    region = safe_update(safe_update(region, False, RULE), False, RULE)
    assert region == TrustRegion(0.8)
    assert safe_update(region, False, box_rule(2, 5), weight=5) == TrustRegion(0.4)


@pytest.mark.parametrize(("d", "q", "rounds"), [(50, 10, 5), (10, 4, 3), (2, 1, 4), (325, 10, 33)])
def test_failure_tolerance_of_the_tutorials(d: int, q: int, rounds: int) -> None:
    assert failure_tolerance(d, q) == rounds


def test_weights_keep_the_volume() -> None:
    weights = relative_weights(np.array([0.1, 1.0, 3.0]))
    assert weights.prod() == pytest.approx(1.0)
    assert weights[2] / weights[0] == pytest.approx(30.0)


def test_candidates_stay_in_the_box_and_perturb_twenty_coordinates() -> None:
    rng = np.random.default_rng(0)
    centre = rng.random(100)
    points = box_candidates(centre, np.full(100, 0.1), 500, rng)
    assert (np.abs(points - centre) <= 0.1 + 1e-12).all()
    changed = (points != centre).sum(axis=1)
    assert changed.min() >= 1
    assert changed.mean() == pytest.approx(20, abs=1)


def test_samples_take_different_candidates() -> None:
    assert distinct_maxima(np.array([[1.0, 3.0, 2.0], [0.0, 9.0, 1.0], [5.0, 1.0, 0.0]])) == [1, 2, 0]


def test_infeasible_ranks_below_feasible_and_by_violation() -> None:
    scores = feasible_first(np.array([[5.0, 1.0, 9.0, -3.0]]), np.array([[2.0, 0.0, 0.5, 0.0]]))[0]
    assert list(np.argsort(-scores)) == [1, 3, 2, 0]


def test_bilog_keeps_sign_and_order() -> None:
    margin = np.linspace(-50, 50, 101)
    assert (np.diff(bilog(margin)) > 0).all()
    np.testing.assert_array_equal(np.sign(bilog(margin)), np.sign(margin))


@pytest.mark.parametrize("kind", [Turbo, Scbo])
def test_a_small_region_starts_anew_with_a_design(kind) -> None:
    problem = bowl_problem()
    problem.function = lambda x: (np.zeros(len(x)), np.ones(len(x)))  # nothing ever improves
    optimizer = kind(problem, seed=0, candidates=100)
    observe_initial(optimizer, 12)
    while optimizer._since == 0:
        run_rounds(optimizer, 1, 8)
    assert optimizer._region == TrustRegion(0.8)
    design = optimizer.ask(8).x
    assert np.ptp(design, axis=0).min() > 0.5  # over the whole box again
    optimizer.tell(np.arange(len(optimizer.trials) - 8, len(optimizer.trials)), np.zeros(8), np.ones(8))
    run_rounds(optimizer, 2, 8)


def test_scbo_finds_the_feasible_set_and_the_optimum() -> None:
    optimizer = Scbo(bowl_problem(threshold=0.2), seed=0, candidates=500)
    x = np.random.default_rng(1).uniform(0.7, 1.0, (10, 4))
    optimizer.observe(x, *optimizer.problem.function(x), initial=True)
    assert optimizer.best() is None
    run_rounds(optimizer, 20, 4)
    # |x - 0.4| <= sqrt(0.05) and top at 0.6: the best is at distance 0.4 - sqrt(0.05) from it
    assert optimizer.best().objective > -((0.4 - np.sqrt(0.05)) ** 2) - 0.01


def test_turbo_finds_the_optimum() -> None:
    optimizer = Turbo(bowl_problem(), seed=0, candidates=500)
    observe_initial(optimizer, 10)
    run_rounds(optimizer, 15, 4)
    assert optimizer.trials.objective.max() > -1e-3


@pytest.mark.parametrize(
    ("inputs", "expected"), [(500, (4, 2)), (1000, (5, 1)), (3575, (6, 1)), (64, (3, 1)), (1, (0, 1))]
)
def test_nesting_comes_nearest_to_the_inputs(inputs: int, expected: tuple[int, int]) -> None:
    assert nesting(inputs, 3) == expected


def low_dimensional(inputs: int) -> FunctionProblem:
    """Two of many inputs matter; the best is 0 at (0.3, -0.4)."""
    return FunctionProblem(
        lambda x: (-((x[:, 0] - 0.3) ** 2) - (x[:, 1] + 0.4) ** 2, np.ones(len(x))),
        np.stack([-np.ones(inputs), np.ones(inputs)]),
    )


@pytest.mark.thorough
def test_baxus_grows_and_keeps_its_observations() -> None:
    problem = low_dimensional(30)
    optimizer = Baxus(problem, seed=0, budget=60, candidates=200)
    optimizer.tell(optimizer.ask(10), *problem.function(optimizer.trials.x))
    first = optimizer._sketch.dimension
    run_rounds(optimizer, 60, 1)
    assert optimizer._sketch.dimension > first
    lifted = optimizer._sketch.lift(optimizer._latent)
    np.testing.assert_allclose(lifted, optimizer.trials.x, atol=1e-12)
    assert optimizer.trials.objective.max() > -1e-2


def test_hesbo_takes_the_dimension_of_the_embedding() -> None:
    class Two:
        def encode(self, x):
            return x[:, :2]

        def decode(self, z):
            raise AssertionError("HeSBO has an embedding of its own")

    optimizer = Hesbo(low_dimensional(40), embedding=Two(), seed=0)
    assert optimizer._sketch.dimension == 2
    assert Hesbo(low_dimensional(40), seed=0)._sketch.dimension == 20


@pytest.mark.thorough
def test_hesbo_finds_the_optimum_when_the_subspace_holds_it() -> None:
    problem = low_dimensional(40)
    optimizer = Hesbo(problem, seed=1, dimension=8)
    assert optimizer._sketch.bins[0] != optimizer._sketch.bins[1]  # else it could not
    for _ in range(5):
        if len(optimizer.trials) == 0 or optimizer.trials.objective.max() < -1e-3:
            run_rounds(optimizer, 1, 8)
    assert optimizer.trials.objective.max() > -1e-3


@pytest.mark.parametrize("kind", [Hesbo, Baxus])
def test_initial_data_from_outside_are_recorded_but_not_used(kind) -> None:
    problem = low_dimensional(20)
    optimizer = kind(problem, seed=0)
    observe_initial(optimizer, 5)
    x = optimizer.ask(4).x
    np.testing.assert_allclose(optimizer._sketch.lift(optimizer._latent[5:]), x, atol=1e-12)
