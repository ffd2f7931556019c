"""Ascents: probe, region, safe set, and the metric of features."""

import numpy as np
import pytest

from hdsafebo.errors import ProblemError
from hdsafebo.optimizers.local.ascents import EXPLORE_RADIUS, AscentSearch
from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
from hdsafebo.problem import FunctionProblem
from optimizers.toy import Halving, bowl_problem, observe_initial, run_rounds


def ascending(problem: FunctionProblem, **options) -> HdSafeBOLocal:
    """Codes of half the size are searched; kernel inputs are those of the unit cube."""
    options = {"empty_safe_set": "mark"} | options
    made = HdSafeBOLocal(problem, embedding=Halving(), bounds=problem.bounds / 2, **options)
    assert type(made.search) is AscentSearch
    return made


def test_first_round_probes_at_spread_radii() -> None:
    optimizer = ascending(bowl_problem(dimension=20, threshold=-3.0), seed=1)
    observe_initial(optimizer, 40)
    centre = optimizer.best().z
    trials = optimizer.ask(5)
    radii = 2.0 * np.linalg.norm(trials.z - centre, axis=1) / optimizer.surrogate.objective.hyper.reference
    np.testing.assert_allclose(np.sort(radii), np.geomspace(1e-3, 2e-2, 5), rtol=0.2)


def test_later_rounds_stay_within_the_region() -> None:
    optimizer = ascending(bowl_problem(dimension=10, threshold=-1.0), seed=2)
    observe_initial(optimizer, 40)
    run_rounds(optimizer, 1, 10)
    centre = optimizer.best().z
    trials = optimizer.ask(10)
    reach, length = optimizer.surrogate.length_scale, optimizer.search.region.length
    distance = 2.0 * np.linalg.norm(trials.z - centre, axis=1)
    assert (distance[:2] <= 1.5 * length * reach + 1e-9).all()
    limit = 1.5 * length + EXPLORE_RADIUS
    assert (distance <= limit * reach + 1e-9).all()


def test_points_are_believed_safe() -> None:
    optimizer = ascending(bowl_problem(), seed=3)
    observe_initial(optimizer, 15)
    run_rounds(optimizer, 8)
    asked = optimizer.trials[optimizer.trials.round > 0]
    believed = asked[~asked.marked_unsafe]
    assert (believed.predicted_safe_probability >= 0.977 - 1e-6).all()
    assert (believed.safety[:, 0] >= 0).mean() > 0.95


def test_finds_the_constrained_optimum() -> None:
    optimizer = ascending(bowl_problem(), seed=4)
    observe_initial(optimizer, 15)
    run_rounds(optimizer, 15)
    assert optimizer.best().objective > -0.005


@pytest.mark.parametrize("n", [1, 2, 7])
def test_any_batch_size(n: int) -> None:
    optimizer = ascending(bowl_problem(), seed=5)
    observe_initial(optimizer)
    for _ in range(3):
        assert len(optimizer.ask(n)) == n
        run_rounds(optimizer, 1, n)


@pytest.mark.parametrize(("n", "exact"), [(10, 2), (15, 3), (7, None), (1, None)])
def test_share_of_the_batch_that_climbs_the_mean(monkeypatch: pytest.MonkeyPatch, n: int, exact) -> None:
    optimizer = ascending(bowl_problem(), seed=6)
    observe_initial(optimizer)
    optimizer.ask(2)
    explorers = []
    monkeypatch.setattr(
        optimizer.search, "_climb_paths", lambda centre, k: explorers.append(k) or np.tile(centre, (k, 1))
    )
    climbed = optimizer.search._climb_mean(optimizer.search.centre(), n)  # the same ascents every time
    monkeypatch.setattr(optimizer.search, "_climb_mean", lambda centre, k: climbed)
    for _ in range(60):
        optimizer.search.propose(n)
    shares = n - np.array(explorers)
    assert shares.mean() == pytest.approx(0.2 * n, abs=0.2)
    if exact is not None:
        assert (shares == exact).all()


def test_explores_around_the_predicted_next_best_point(monkeypatch: pytest.MonkeyPatch) -> None:
    optimizer = ascending(bowl_problem(dimension=10, threshold=-1.0), seed=2)
    observe_initial(optimizer, 40)
    run_rounds(optimizer, 2, 10)
    centres = []
    explore = optimizer.search._climb_paths
    monkeypatch.setattr(optimizer.search, "_climb_paths", lambda c, k: centres.append(c) or explore(c, k))
    optimizer.propose(10)
    start = optimizer.space.to_unit(optimizer.best().z[None])[0]
    inputs = optimizer.search.metric.inputs(np.stack([centres[0], start]))
    predicted = optimizer.surrogate.objective.predict_mean(inputs)
    assert predicted[0] > predicted[1]


def test_centre_is_believed_safe() -> None:
    """A point that was safe amid unsafe ones is not built upon while another one is believed safe."""
    optimizer = ascending(bowl_problem(), seed=0)
    x = np.vstack([np.full((1, 4), 0.5), 0.5 + 0.02 * np.random.default_rng(0).standard_normal((20, 4))])
    far = 0.1 + 0.02 * np.random.default_rng(1).standard_normal((20, 4))
    objective = np.append(np.full(21, 5.0), np.zeros(20))
    safety = np.concatenate([[0.01], np.full(20, -1.0), np.ones(20)])
    optimizer.observe(np.vstack([x, far]), objective, safety, initial=True)
    assert optimizer.best().id == 0
    assert optimizer.centre_row() > 20


def test_region_follows_the_rounds() -> None:
    optimizer = ascending(bowl_problem())
    observe_initial(optimizer)
    for value in (5.0, 6.0):
        optimizer.tell(optimizer.ask(2), [value, value + 0.5], [1.0, -1.0])  # one trial was not safe
    assert optimizer.search.region.length == pytest.approx(0.75)
    for _ in range(3):
        optimizer.tell(optimizer.ask(2), [0.0, 0.0], [1.0, 1.0])
    assert optimizer.search.region.length == pytest.approx(0.5)


class TestFeatures:
    """A problem whose kernel inputs are an affine map of its inputs."""

    matrix = np.array([[3.0, 0.0, 0.0, 0.0], [0.0, 0.2, 0.1, 0.0], [0.0, 0.0, 1.0, 1.0]])

    def problem(self):
        problem = bowl_problem()
        problem.features = lambda x: x @ self.matrix.T + 7.0
        return problem

    @pytest.mark.parametrize("embedding", [None, Halving()])
    def test_metric_is_that_of_the_features(self, embedding) -> None:
        optimizer = HdSafeBOLocal(self.problem(), embedding=embedding)
        observe_initial(optimizer)
        trials = optimizer.trials
        u = optimizer.space.to_unit(trials.z)
        np.testing.assert_allclose(optimizer.search.metric.inputs(u), optimizer.kernel_inputs(trials))
        np.testing.assert_allclose(optimizer.kernel_inputs(trials), trials.x @ self.matrix.T + 7.0)

    def test_radii_are_lengths_of_features(self) -> None:
        optimizer = HdSafeBOLocal(self.problem(), seed=1, empty_safe_set="mark")
        observe_initial(optimizer, 40)
        run_rounds(optimizer, 1, 10)
        centre = optimizer.kernel_inputs(optimizer.trials[[optimizer.best().id]])
        trials = optimizer.ask(10)
        distance = np.linalg.norm(optimizer.kernel_inputs(trials) - centre, axis=1)
        reach = optimizer.search.region.length * optimizer.surrogate.length_scale
        assert (distance <= 2.0 * reach + 1e-9).all()
        run_rounds(optimizer, 8, 4)
        assert np.isfinite(optimizer.trials.predicted_safe_probability[-4:]).all()

    def test_features_must_be_affine(self) -> None:
        problem = bowl_problem()
        problem.features = np.sin
        optimizer = HdSafeBOLocal(problem)
        observe_initial(optimizer)
        with pytest.raises(ProblemError, match=r"features of 'bowl' differ by .* affine"):
            optimizer.ask(2)
