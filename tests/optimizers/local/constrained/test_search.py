"""The search of the inputs themselves: optimum, safety, region, incumbents, and what it is told."""

from dataclasses import replace

import numpy as np
import pytest

from hdsafebo.errors import NoSafePointError, TrialError
from hdsafebo.gp.warped_surrogate import SAFETY, WarpedSurrogate
from hdsafebo.optimizers.local.ascents import AscentSearch
from hdsafebo.optimizers.local.constrained.search import ConstrainedSearch
from hdsafebo.optimizers.local.optimizer import HdSafeBOLocal
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.trials import Status
from hdsafebo.typing import FloatArray
from optimizers.toy import Halving, bowl_problem, observe_initial, rows_problem, run_rounds


def corner(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The optimum lies where two constraints meet, of which one spans orders of magnitude: 0.5, 0.25."""
    first = np.expm1(10 * (0.5 - x[:, 0])) * 100
    return x[:, 0] + x[:, 1], np.column_stack([first, 0.25 - x[:, 1] + 0.5 * (0.5 - x[:, 0])])


def corner_problem(dimension: int = 2) -> FunctionProblem:
    bounds = [[0.0] * dimension, [1.0] * dimension]
    return FunctionProblem(corner, bounds, [Safety("steep", 0.0), Safety("slope", 0.0)], name="corner")


def started(problem: FunctionProblem, n: int = 12, **settings: object) -> HdSafeBOLocal:
    made = HdSafeBOLocal(problem, seed=2, **settings)
    observe_initial(made, n)
    return made


def search_of(made: HdSafeBOLocal) -> ConstrainedSearch:
    assert isinstance(made.search, ConstrainedSearch)
    return made.search


@pytest.mark.parametrize("batch", [1, 2, 5])
@pytest.mark.thorough
def test_finds_a_corner_of_the_safe_set_without_leaving_it(batch: int) -> None:
    made = started(corner_problem())
    run_rounds(made, 40 // batch, batch)
    assert made.best().objective == pytest.approx(0.75, abs=2e-3)
    assert made.feasible[12:].mean() >= 0.97
    assert made.trials.marked_unsafe[12:].mean() <= 0.05


def test_inputs_that_do_not_matter_are_found_out() -> None:
    made = started(corner_problem(8), 24)
    run_rounds(made, 10, 5)
    assert made.best().objective == pytest.approx(0.75, abs=0.02)
    lengths = made.surrogate.objective.length_scales
    assert lengths[2:].min() > 2 * lengths[:2].max()


def test_noise_is_not_taken_for_an_error_of_the_model() -> None:
    problem, rng = bowl_problem(), np.random.default_rng(0)
    made = started(problem, 20)
    truth = []
    for _ in range(10):
        trials = made.ask(4)
        objective, safety = problem.function(trials.x)
        truth.append(safety)
        made.tell(trials, objective + 0.01 * rng.standard_normal(4), safety + 0.01 * rng.standard_normal(4))
    assert (np.concatenate(truth) >= 0).mean() >= 0.95
    assert made.surrogate.inflation[0] < 3.0
    x = made.trials.x[made.centre_row()]
    assert problem.function(x[None])[0][0] > -0.06  # the optimum is 0 at the edge of the safe set


@pytest.mark.parametrize(
    ("make", "kind"),
    [
        (lambda: HdSafeBOLocal(bowl_problem()), ConstrainedSearch),
        (lambda: HdSafeBOLocal(bowl_problem(dimension=101)), AscentSearch),
        (
            lambda: HdSafeBOLocal(bowl_problem(), embedding=Halving(), bounds=[[0.0] * 4, [0.5] * 4]),
            AscentSearch,
        ),
    ],
)
def test_which_search_runs(make, kind: type) -> None:
    assert type(make().search) is kind
    assert type(HdSafeBOLocal(rows_problem()).search).__name__ == "RowSearch"


def test_it_ends_with_the_first_failure_that_teaches(tmp_path) -> None:
    problem = bowl_problem()
    problem.failures_teach = True
    made = started(problem)
    run_rounds(made, 2, 2)
    search_of(made)
    trials = made.ask(2)
    objective, safety = problem.function(trials.x)
    with pytest.raises(TrialError, match="finite"):  # a refused call goes back to the search before
        made.tell(trials, [np.nan, np.nan], safety, status=[Status.FAILED, Status.COMPLETED])
    search_of(made)
    made.tell(trials.id[:1], objective[:1], safety[:1], status=[Status.FAILED])
    made.save(tmp_path / "state")
    loaded = HdSafeBOLocal.load(tmp_path / "state", problem)
    for optimizer in (made, loaded):
        optimizer.tell(trials.id[1:], objective[1:], safety[1:])
        assert type(optimizer.search) is AscentSearch
        assert optimizer.surrogate.completion
    np.testing.assert_array_equal(made.ask(2).x, loaded.ask(2).x)

    problem.failures_teach = False
    ignoring = started(problem)
    asked = ignoring.ask(1)
    ignoring.tell(asked, [0.0], [0.0], status=[Status.FAILED])
    search_of(ignoring)


def test_the_region_grows_and_shrinks_with_violations() -> None:
    made = started(bowl_problem())
    lengths = []
    for shift in (0.0, 0.0, -1.0):
        trials = made.ask(5)
        assert not trials.marked_unsafe.any()
        objective, safety = made.problem.function(trials.x)
        made.tell(trials, objective, safety + shift)
        lengths.append(search_of(made).region.length)
    assert lengths == pytest.approx([0.1, 0.2, 0.1])  # the first round only probes


def test_trials_lie_apart_from_known_open_and_failed_ones() -> None:
    made = started(bowl_problem())
    run_rounds(made, 3, 5)
    first = made.ask(5)
    made.tell(first[[0]], [np.nan], [np.nan], status=Status.FAILED)
    made.ask(5)
    x = made.trials.x
    apart = [np.linalg.norm(x[:i] - x[i], axis=1).min() for i in range(17, len(x))]  # after the probes
    assert min(apart) >= 1e-3


def test_while_nothing_is_gained_trials_look_far() -> None:
    made = started(bowl_problem())
    run_rounds(made, 2, 5)
    search = search_of(made)
    search.region = type(search.region)(0.01)
    centre = made.trials.x[made.centre_row()]
    near = made.ask(5)
    assert np.abs(near.x - centre).max() <= 0.01 + 1e-9
    made.tell(near, *made.problem.function(near.x))
    search._stalled, search.region = 10, type(search.region)(0.01)
    centre = made.trials.x[made.centre_row()]
    far = np.abs(made.ask(5).x - centre).max(axis=1)
    assert far[0] <= 0.01 + 1e-9
    assert far[1:].max() > 0.05


def test_a_lucky_trial_is_not_the_incumbent() -> None:
    """Amid noise the highest outcome is passed over for the highest mean."""
    rng = np.random.default_rng(0)
    made = HdSafeBOLocal(bowl_problem(), seed=0)
    x = rng.random((60, 4)) * 0.2 + 0.35
    objective = -((x - 0.4) ** 2).sum(axis=1) + 0.02 * rng.standard_normal(60)
    far = int(np.abs(x - 0.4).sum(axis=1).argmax())
    objective[far] = 0.08
    made.observe(x, objective, 1.0 + 0.02 * rng.standard_normal(60), initial=True)
    assert made.best().id == far
    assert made.centre_row() != far


def test_no_safe_trial() -> None:
    x = np.random.default_rng(0).random((12, 4))
    for policy in ("mark", "abstain"):
        made = HdSafeBOLocal(bowl_problem(threshold=10.0), empty_safe_set=policy)
        made.observe(x, np.zeros(12), np.full(12, -1.0), initial=True)
        if policy == "abstain":
            with pytest.raises(NoSafePointError, match="none of the 12 completed trials"):
                made.ask(3)
        else:
            assert made.ask(3).marked_unsafe.all()


@pytest.mark.parametrize("n", [1, 4])
def test_one_dimension_and_constant_constraints(n: int) -> None:
    def function(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return -((x[:, 0] - 0.3) ** 2), np.column_stack([np.ones(len(x)), 0.5 - x[:, 0]])

    problem = FunctionProblem(function, [[0.0], [1.0]], [Safety("always", 0.0), Safety("side", 0.0)])
    made = HdSafeBOLocal(problem, seed=1)
    made.observe([[0.1], [0.45], [0.9]], *function(np.array([[0.1], [0.45], [0.9]])), initial=True)
    run_rounds(made, 20 // n, n)
    assert made.best().objective > -1e-4
    assert made.feasible[3:].mean() >= 0.9


def test_dimensions_without_width_stay_where_they_are() -> None:
    problem = bowl_problem()
    problem.bounds[:, 2] = 0.4
    made = started(problem)
    run_rounds(made, 4, 5)
    assert (made.trials.x[:, 2] == 0.4).all()
    assert made.surrogate.inputs.shape[1] == 3


def test_an_outlier_does_not_stop_it() -> None:
    made = HdSafeBOLocal(bowl_problem(), seed=2)
    x, _ = made.problem.initial(12, np.random.default_rng(0))
    objective, safety = made.problem.function(x)
    objective[0], safety[0] = -1e12, -1e12
    made.observe(x, objective, safety, initial=True)
    run_rounds(made, 8, 5)
    assert made.best().objective > -0.01
    assert made.feasible[12:].mean() >= 0.95


def test_its_model_runs_in_botorch() -> None:
    torch = pytest.importorskip("torch")
    made = started(corner_problem(), 20)
    run_rounds(made, 2, 5)
    surrogate = made.surrogate
    assert isinstance(surrogate, WarpedSurrogate)
    query = np.random.default_rng(5).random((30, 2))
    with torch.no_grad():
        posterior = made.model.posterior(torch.from_numpy(query))
        samples = posterior.rsample(torch.Size([4000]))
    for j, process in enumerate((surrogate.objective, *surrogate.safety)):
        median, deviation = process.predict(query)
        middle = samples[..., j].median(dim=0).values.numpy()
        np.testing.assert_allclose(middle, median, atol=float(0.2 * deviation.max() + 0.02 * np.ptp(median)))
        spread = samples[..., j].std(dim=0).numpy()
        np.testing.assert_allclose(spread, posterior.variance[:, j].sqrt().numpy(), rtol=0.2)


def test_what_is_known_in_one_place_is_left_in_steps() -> None:
    def wavy(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return x.sum(axis=1), 3.0 + np.sin(8.0 * x).sum(axis=1) / 4.0

    problem = FunctionProblem(wavy, [[0.0] * 4, [1.0] * 4], [Safety("wavy", 0.0)], name="wavy")
    made = HdSafeBOLocal(problem, seed=3)
    x = 0.3 + 0.05 * np.random.default_rng(3).uniform(-1.0, 1.0, (5, 4))
    made.observe(x, *problem.function(x), initial=True)
    run_rounds(made, 2, 5)
    search_of(made).region = replace(search_of(made).region, length=1.0)
    asked = made.ask(5)
    model = search_of(made).model
    _, deviations = model.posteriors.over(asked.x[~asked.marked_unsafe], SAFETY)
    assert deviations.size
    assert (deviations <= 0.51 * model.posteriors.signal[SAFETY][:, None]).all()
