"""The local variant: probe, ascents, feature maps and finite sets."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtri

from hdsafebo.errors import ProblemError
from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
from hdsafebo.optimizers.local.recombination import safe_steps
from hdsafebo.typing import FloatArray
from optimizers.toy import Halving, bowl_problem, observe_initial, rows_problem, run_rounds


def test_first_round_probes_at_spread_radii() -> None:
    optimizer = HdSafeBOLocal(
        bowl_problem(dimension=20, threshold=-3.0), seed=1, probe_min=1e-3, probe_max=1e-1
    )
    observe_initial(optimizer, 40)
    centre = optimizer.best().x[0]
    trials = optimizer.ask(5)
    radii = np.linalg.norm(trials.x - centre, axis=1) / optimizer.surrogate.objective.hyper.reference
    np.testing.assert_allclose(np.sort(radii), np.geomspace(1e-3, 1e-1, 5), rtol=0.2)


def test_later_rounds_stay_within_the_region() -> None:
    optimizer = HdSafeBOLocal(bowl_problem(dimension=10, threshold=-1.0), seed=2)
    observe_initial(optimizer, 40)
    run_rounds(optimizer, 1, 10)
    centre = optimizer.best().x[0]
    trials = optimizer.ask(10)
    reach = optimizer.surrogate.length_scale
    distance = np.linalg.norm(trials.x - centre, axis=1)
    assert (distance[:2] <= 1.5 * optimizer.region.length * reach + 1e-9).all()
    limit = 1.5 * optimizer.region.length + optimizer.settings.explore_radius
    assert (distance <= limit * reach + 1e-9).all()


def test_points_are_believed_safe() -> None:
    optimizer = HdSafeBOLocal(bowl_problem(), seed=3)
    observe_initial(optimizer, 15)
    run_rounds(optimizer, 8)
    asked = optimizer.trials[optimizer.trials.round > 0]
    believed = asked[~asked.marked_unsafe]
    assert (believed.predicted_safe_probability >= 0.977 - 1e-6).all()
    assert (believed.safety[:, 0] >= 0).mean() > 0.95


@pytest.mark.parametrize("embedding", [None, Halving()])
def test_finds_the_constrained_optimum(embedding) -> None:
    optimizer = HdSafeBOLocal(bowl_problem(), seed=4, embedding=embedding)
    observe_initial(optimizer, 15)
    run_rounds(optimizer, 15)
    assert optimizer.best().objective[0] > -0.005


@pytest.mark.parametrize("n", [1, 2, 7])
def test_any_batch_size(n: int) -> None:
    optimizer = HdSafeBOLocal(bowl_problem(), seed=5)
    observe_initial(optimizer)
    for _ in range(3):
        assert len(optimizer.ask(n)) == n
        run_rounds(optimizer, 1, n)


@pytest.mark.parametrize(("n", "exact"), [(10, 3), (5, None), (1, None)])
def test_share_of_the_batch_that_climbs_the_mean(monkeypatch: pytest.MonkeyPatch, n: int, exact) -> None:
    optimizer = HdSafeBOLocal(bowl_problem(), seed=6, exploit=0.3)
    observe_initial(optimizer)
    optimizer.ask(2)
    explorers = []
    monkeypatch.setattr(
        optimizer, "_explore", lambda centre, k: explorers.append(k) or np.tile(centre, (k, 1))
    )
    for _ in range(60):
        optimizer.propose(n)
    shares = n - np.array(explorers)
    assert shares.mean() == pytest.approx(0.3 * n, abs=0.2)
    if exact is not None:
        assert (shares == exact).all()


def test_explores_around_the_predicted_next_best_point(monkeypatch: pytest.MonkeyPatch) -> None:
    optimizer = HdSafeBOLocal(bowl_problem(dimension=10, threshold=-1.0), seed=2)
    observe_initial(optimizer, 40)
    run_rounds(optimizer, 2, 10)
    centres = []
    explore = optimizer._explore
    monkeypatch.setattr(optimizer, "_explore", lambda c, k: centres.append(c) or explore(c, k))
    optimizer.propose(10)
    start = optimizer.space.to_unit(optimizer.best().z)[0]
    predicted = optimizer.surrogate.objective.predict_mean(np.stack([centres[0], start]))
    assert predicted[0] > predicted[1]


def test_centre_is_believed_safe() -> None:
    """A point that was safe amid unsafe ones is not built upon while another one is believed safe."""
    optimizer = HdSafeBOLocal(bowl_problem(), seed=0)
    x = np.vstack([np.full((1, 4), 0.5), 0.5 + 0.02 * np.random.default_rng(0).standard_normal((20, 4))])
    far = 0.1 + 0.02 * np.random.default_rng(1).standard_normal((20, 4))
    objective = np.append(np.full(21, 5.0), np.zeros(20))
    safety = np.concatenate([[0.01], np.full(20, -1.0), np.ones(20)])
    optimizer.observe(np.vstack([x, far]), objective, safety, initial=True)
    assert optimizer.best().id[0] == 0
    assert optimizer.centre_row() > 20


def test_region_follows_the_rounds() -> None:
    optimizer = HdSafeBOLocal(bowl_problem(), success_tolerance=1, failure_tolerance=1)
    observe_initial(optimizer)
    trials = optimizer.ask(2)
    optimizer.tell(trials, [5.0, 6.0], [1.0, -1.0])  # better, though one trial was not safe
    assert optimizer.region.length == pytest.approx(0.75)
    optimizer.tell(optimizer.ask(1), [0.0], [1.0])
    assert optimizer.region.length == pytest.approx(0.5)


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
        np.testing.assert_allclose(optimizer.metric.inputs(u), optimizer.kernel_inputs(trials))
        np.testing.assert_allclose(optimizer.kernel_inputs(trials), trials.x @ self.matrix.T + 7.0)

    def test_radii_are_lengths_of_features(self) -> None:
        optimizer = HdSafeBOLocal(self.problem(), seed=1)
        observe_initial(optimizer, 40)
        run_rounds(optimizer, 1, 10)
        centre = optimizer.kernel_inputs(optimizer.best())
        trials = optimizer.ask(10)
        distance = np.linalg.norm(optimizer.kernel_inputs(trials) - centre, axis=1)
        assert (distance <= 2.0 * optimizer.region.length * optimizer.surrogate.length_scale + 1e-9).all()
        run_rounds(optimizer, 8, 4)
        assert np.isfinite(optimizer.trials.predicted_safe_probability[-4:]).all()

    def test_features_must_be_affine(self) -> None:
        problem = bowl_problem()
        problem.features = np.sin
        optimizer = HdSafeBOLocal(problem)
        observe_initial(optimizer)
        with pytest.raises(ProblemError, match=r"features of 'bowl' differ by .* affine"):
            optimizer.ask(2)


class TestHiddenDirections:
    """The features see the difference of the last two coordinates only; the optimum needs their sum."""

    def optimizer(self, seed: int = 3, threshold: float = 0.0, **settings) -> HdSafeBOLocal:
        problem = bowl_problem(threshold)
        matrix = np.vstack([np.eye(4)[:2], [0.0, 0.0, 1.0, -1.0]])
        problem.features = lambda x: x @ matrix.T
        optimizer = HdSafeBOLocal(problem, seed=seed, **settings)
        assert optimizer.metric.hides_directions
        return optimizer

    def test_they_are_searched(self) -> None:
        optimizer = self.optimizer()
        start = observe_initial(optimizer, 15)
        best = start.x[np.argmax(np.where(start.safety[:, 0] >= 0, start.objective, -np.inf))]
        assert abs(best[2:].sum() - 1.2) > 0.1
        first = optimizer.ask(10)
        assert np.ptp((first.x - best)[:, 2:].sum(axis=1)) > 0.01
        assert (first.predicted_safe_probability[~first.marked_unsafe] >= 0.977 - 1e-6).all()
        optimizer.tell(first, *optimizer.problem.function(first.x))
        run_rounds(optimizer, 10, 10)
        assert abs(optimizer.best().x[0, 2:].sum() - 1.2) < 0.05

    def test_centre_is_a_mean_of_the_best_feasible_trials(self, centres: list[FloatArray]) -> None:
        optimizer = self.optimizer(exploit=0.0, threshold=-3.0)
        observe_initial(optimizer, 150)
        optimizer.ask(8)
        np.testing.assert_allclose(centres[-1], self.mean_of_best(optimizer, np.arange(150)))

    def test_parents_are_recent(self, centres: list[FloatArray]) -> None:
        optimizer = self.optimizer(exploit=0.0, threshold=-3.0, parents_from=30, least_step=0.3)
        observe_initial(optimizer, 150)
        run_rounds(optimizer, 2, 10)
        known = np.arange(170)
        optimizer.ask(10)
        np.testing.assert_allclose(centres[-1], self.mean_of_best(optimizer, known))
        last = optimizer.trials[-10:]
        optimizer.tell(last, *optimizer.problem.function(last.x))
        optimizer.ask(8)
        np.testing.assert_allclose(centres[-1], self.mean_of_best(optimizer, np.arange(150, 180)))

    def mean_of_best(self, optimizer: HdSafeBOLocal, rows: NDArray[np.int64]) -> FloatArray:
        rows = rows[optimizer.feasible[rows]]
        best = rows[np.argsort(-optimizer.trials.objective[rows])][:10]
        weights = np.log(10.5) - np.log(np.arange(1, 11))
        return weights / weights.sum() @ optimizer.space.to_unit(optimizer.trials.z[best])

    @pytest.fixture
    def centres(self, monkeypatch: pytest.MonkeyPatch) -> list[FloatArray]:
        """Centres of the steps so far."""
        used: list[FloatArray] = []

        def watched(surrogate, metric, centre, *args):
            used.append(centre)
            return safe_steps(surrogate, metric, centre, *args)

        monkeypatch.setattr("hdsafebo.optimizers.local.optimizer.safe_steps", watched)
        return used

    def test_outcomes_are_normal_scores_with_noise(self) -> None:
        optimizer = self.optimizer()
        observe_initial(optimizer, 150)
        model = optimizer.surrogate.objective
        raw = model.outcomes.restore(model.values)
        assert np.abs(raw).max() == pytest.approx(ndtri(1 - 0.5 / 150))
        np.testing.assert_array_equal(np.argsort(raw), np.argsort(optimizer.trials.objective))
        assert all(gp.hyper.noise_ratio >= 0.999 / 30 for gp in (model, *optimizer.surrogate.safety))

    @pytest.mark.parametrize("exploit", [0.0, 1.0])
    def test_any_share_of_climbs(self, exploit: float) -> None:
        optimizer = self.optimizer(exploit=exploit)
        observe_initial(optimizer, 15)
        run_rounds(optimizer, 3, 4)
        assert len(optimizer.trials) == 27

    def test_nothing_safe_is_said(self) -> None:
        optimizer = self.optimizer()
        x = np.random.default_rng(0).random((6, 4))
        optimizer.observe(x, np.zeros(6), np.full(6, -1.0), initial=True)
        assert optimizer.ask(4).marked_unsafe.all()


class TestFiniteSet:
    """Only some inputs can be evaluated."""

    def test_rows_are_believed_safe_and_new(self) -> None:
        optimizer = HdSafeBOLocal(
            rows_problem(2000), seed=1, rows_initial=200, rows_elsewhere=100, rows_min=20
        )
        observe_initial(optimizer, 20)
        run_rounds(optimizer, 6)
        asked = optimizer.trials[optimizer.trials.round > 0]
        assert len(np.unique(optimizer.trials.candidate)) == len(optimizer.trials)
        assert (asked.predicted_safe_probability[~asked.marked_unsafe] >= 0.977 - 1e-6).all()
        np.testing.assert_array_equal(asked.x, optimizer.problem.candidates.features[asked.candidate])

    def test_finds_the_best_safe_row(self) -> None:
        problem = rows_problem(2000)
        optimizer = HdSafeBOLocal(problem, seed=2)
        observe_initial(optimizer, 20)
        run_rounds(optimizer, 12)
        objective, safety = problem.function(problem.candidates.features)
        assert optimizer.best().objective[0] >= np.sort(objective[safety >= 0])[-3]

    def test_neighbourhood_is_the_nearest_rows(self) -> None:
        optimizer = HdSafeBOLocal(rows_problem(500), seed=3, regions=1, rows_initial=50, rows_elsewhere=0)
        observe_initial(optimizer, 20)
        centre = optimizer.best().x[0]
        trials = optimizer.ask(5)
        free = np.setdiff1d(np.arange(500), optimizer.trials.candidate[:20])
        distance = np.linalg.norm(optimizer.problem.candidates.features - centre, axis=1)
        limit = np.sort(distance[free])[49]
        assert (distance[trials.candidate] <= limit + 1e-12).all()

    def test_regions_lie_a_length_scale_apart_around_the_best(self) -> None:
        problem = rows_problem(2000)
        bowl = problem.function
        problem.function = lambda x: (np.sin(12 * x).sum(axis=1), bowl(x)[1])  # several tops
        optimizer = HdSafeBOLocal(problem, seed=3, regions=3, rows_initial=60, rows_elsewhere=0)
        observe_initial(optimizer, 100)
        features = problem.candidates.features
        gp = optimizer.surrogate.objective
        known = optimizer.trials[optimizer.feasible]
        safe = optimizer.surrogate.believed_safe(features[known.candidate], -2.0)
        known = known[np.flatnonzero(safe)[np.argsort(-known.objective[safe], kind="stable")]]
        centres = [known.x[0]]
        for x in known.x:
            if len(centres) < 3 and min(np.linalg.norm(x - c) for c in centres) >= gp.length_scale:
                centres.append(x)
        assert len(centres) > 1  # or nothing is tested
        free = np.setdiff1d(np.arange(2000), optimizer.trials.candidate)
        near = [
            free[np.argsort(np.linalg.norm(features[free] - c, axis=1))[: 60 // len(centres)]]
            for c in centres
        ]
        trials = optimizer.ask(10)
        assert set(trials.candidate) <= set(np.concatenate(near))

    def test_inputs_outside_the_set_count_as_their_nearest_row(self) -> None:
        optimizer = HdSafeBOLocal(rows_problem(500))
        observe_initial(optimizer, 20)
        optimizer.observe([[0.5, 0.5]], [0.0], [0.1])
        features = optimizer.problem.candidates.features
        nearest = features[np.linalg.norm(features - 0.5, axis=1).argmin()]
        np.testing.assert_array_equal(optimizer.kernel_inputs(optimizer.trials)[-1], nearest)

    def test_last_rows(self) -> None:
        optimizer = HdSafeBOLocal(rows_problem(30))
        observe_initial(optimizer, 10)
        assert sorted(optimizer.ask(20).candidate) == sorted(
            set(range(30)) - set(optimizer.trials.candidate[:10])
        )
