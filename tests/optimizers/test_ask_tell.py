"""The interface that all optimisers share."""

from dataclasses import fields

import numpy as np
import pytest

from hdsafebo.errors import NoSafePointError, ProblemError, TrialError
from hdsafebo.optimizers.hdsafebo import HdSafeBO
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.trials import Status, Trials
from optimizers.toy import Halving, bowl, bowl_problem, observe_initial, rows_problem, run_rounds


def same(a: Trials, b: Trials) -> bool:
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name), equal_nan=True) for f in fields(Trials))


@pytest.fixture
def optimizer() -> HdSafeBO:
    made = HdSafeBO(bowl_problem(), seed=1)
    observe_initial(made)
    return made


def test_a_round(optimizer: HdSafeBO) -> None:
    trials = optimizer.ask(3)
    assert trials.id.tolist() == [12, 13, 14]
    assert (trials.status == Status.PENDING).all()
    assert (trials.round == 1).all()
    assert ((trials.predicted_safe_probability >= 0) & (trials.predicted_safe_probability <= 1)).all()
    assert (trials.violation_bound > 0).all()
    assert (trials.x >= 0).all()
    assert (trials.x <= 1).all()
    optimizer.tell(trials, *bowl(trials.x))
    assert optimizer.trials.completed.all()
    np.testing.assert_array_equal(optimizer.trials.objective[12:], bowl(trials.x)[0])


def test_best_is_the_best_safe_trial(optimizer: HdSafeBO) -> None:
    best = optimizer.best()
    assert best is not None
    safe = optimizer.feasible
    assert best.objective == optimizer.trials.objective[safe].max()
    assert optimizer.trials.objective.max() >= best.objective
    optimizer.observe([[0.6] * 4], [99.0], [-1.0])
    assert optimizer.best().objective == best.objective
    optimizer.observe([[0.6] * 4], [98.0], [0.0])  # on the threshold is safe
    assert optimizer.best().objective == 98.0


def test_best_of_nothing_safe() -> None:
    made = HdSafeBO(bowl_problem(threshold=10.0))
    assert made.best() is None
    observe_initial(made)
    assert made.best() is None


def test_results_come_in_any_order_and_in_parts(optimizer: HdSafeBO) -> None:
    other = HdSafeBO(bowl_problem(), seed=1)
    observe_initial(other)
    for made, parts in ((optimizer, [[0, 1, 2, 3]]), (other, [[2], [3, 0], [1]])):
        trials = made.ask(4)
        for part in parts:
            made.tell(trials[part], *bowl(trials.x[part]))
    assert same(optimizer.trials, other.trials)
    assert same(optimizer.ask(4), other.ask(4))


def test_ids_will_do(optimizer: HdSafeBO) -> None:
    trials = optimizer.ask(2)
    objective, safety = bowl(trials.x)
    optimizer.tell([13, 12], objective[::-1], safety[::-1])
    np.testing.assert_array_equal(optimizer.trials.objective[12:], objective)


def test_telling_twice_changes_nothing(optimizer: HdSafeBO) -> None:
    trials = optimizer.ask(4)
    results = bowl(trials.x)
    optimizer.tell(trials, *results)
    region, before = optimizer.region, optimizer.trials
    optimizer.tell(trials, *results)
    optimizer.tell(trials[[1, 1]], *(values[[1, 1]] for values in results))
    assert optimizer.region == region
    assert same(before, optimizer.trials)


def test_conflicting_result_keeps_the_first_and_takes_nothing_else(optimizer: HdSafeBO) -> None:
    trials = optimizer.ask(2)
    objective, safety = bowl(trials.x)
    optimizer.tell(trials[[0]], objective[:1], safety[:1])
    with pytest.raises(TrialError, match=r"trial 12 had objective .* the first result stays"):
        optimizer.tell(trials, objective + np.array([1e-9, 0.0]), safety)
    assert optimizer.trials.objective[12] == objective[0]
    assert optimizer.trials.status[13] == Status.PENDING  # all of a call or nothing
    with pytest.raises(TrialError, match="trial 13 had"):
        optimizer.tell(trials[[1, 1]], [1.0, 2.0], [0.0, 0.0])
    assert optimizer.trials.status[13] == Status.PENDING


def test_failed_trials_are_a_status(optimizer: HdSafeBO) -> None:
    trials = optimizer.ask(3)
    objective, safety = bowl(trials.x)
    status = [Status.COMPLETED, Status.FAILED, Status.COMPLETED]
    optimizer.tell(
        trials, [objective[0], np.nan, objective[2]], [safety[0], np.inf, safety[2]], status=status
    )
    assert optimizer.trials.status[13] == Status.FAILED
    assert np.isnan(optimizer.trials.objective[13])
    assert np.isnan(optimizer.trials.safety[13]).all()
    assert len(optimizer.surrogate.inputs) == 14
    assert not optimizer.feasible[13]
    assert len(optimizer.ask(3)) == 3


def test_pending_trials_do_not_enter_the_fit(optimizer: HdSafeBO) -> None:
    optimizer.ask(3)
    assert len(optimizer.surrogate.inputs) == 12
    later = optimizer.ask(3)
    assert later.id.tolist() == [15, 16, 17]
    optimizer.tell(later, *bowl(later.x))  # the first round is still out
    assert len(optimizer.surrogate.inputs) == 15


def test_pending_candidates_are_not_proposed_again() -> None:
    problem = rows_problem(60)
    made = HdSafeBO(problem, empty_safe_set="mark")
    observe_initial(made, 20)
    seen = made.trials.candidate.tolist()
    elsewhere = Trials.pending(
        np.zeros((1, 2)),
        np.zeros((1, 2)),
        1,
        candidate=np.array([made.problem.candidates.nearest(np.array([[0.5, 0.5]]), made.taken)[0]]),
    )
    for _ in range(3):
        trials = made.ask(10, pending=elsewhere)
        seen += trials.candidate.tolist()
    assert len(set(seen)) == len(seen) == 50
    assert elsewhere.candidate[0] not in seen
    assert len(made.ask(30)) == 10  # no more are left
    with pytest.raises(TrialError, match="all 60 candidates"):
        made.ask(1)


def test_predictions_speak_of_the_row_that_is_evaluated() -> None:
    made = HdSafeBO(rows_problem(50))
    observe_initial(made, 20)
    trials = made.ask(5)
    np.testing.assert_array_equal(trials.x, made.problem.candidates.features[trials.candidate])
    np.testing.assert_array_equal(trials.z, trials.x)
    inputs = made.space.kernel_inputs(made.space.to_unit(trials.z))
    np.testing.assert_allclose(trials.predicted_safe_probability, made.surrogate.safe_probability(inputs))


def test_codes_are_those_of_the_evaluated_input() -> None:
    made = HdSafeBO(bowl_problem(), embedding=Halving(), seed=2)
    observe_initial(made)
    trials = made.ask(4)
    np.testing.assert_allclose(trials.z, trials.x / 2)
    initial = made.trials.z[:12]
    np.testing.assert_array_equal(made.space.bounds, [initial.min(axis=0), initial.max(axis=0)])


def test_a_searched_code_stays_when_the_encoder_does_not_undo_the_decoder() -> None:
    class Lossy(Halving):
        """As autoencoders do, it encodes near to the code that was decoded."""

        def encode(self, x):
            return 0.45 * x

    made = HdSafeBO(bowl_problem(), embedding=Lossy(), bounds=[[0.0] * 4, [0.5] * 4], seed=2)
    initial = observe_initial(made)
    np.testing.assert_array_equal(initial.z, 0.45 * initial.x)
    trials = made.ask(4)
    np.testing.assert_allclose(trials.z, trials.x / 2)  # the code that was believed safe, and its image
    np.testing.assert_array_equal(made.space.to_unit(trials.z).clip(0, 1), made.space.to_unit(trials.z))


def test_observed_inputs_keep_the_codes_they_were_decoded_from() -> None:
    made = HdSafeBO(bowl_problem(), embedding=Halving())
    x = np.full((3, 4), 0.4)
    codes = np.full((3, 4), 0.3)
    codes[1, 2] = np.nan
    seen = made.observe(x, *bowl(x), codes=codes)
    np.testing.assert_array_equal(seen.z[[0, 2]], codes[[0, 2]])
    np.testing.assert_array_equal(seen.z[1], 0.2)
    with pytest.raises(TrialError, match=r"codes have shape \(2, 4\); expected \(3, 4\)"):
        made.observe(x, *bowl(x), codes=codes[:2])


def test_inputs_stay_within_the_bounds_of_the_problem() -> None:
    class Far(Halving):
        def decode(self, z):
            return 2 * z + 5.0

    made = HdSafeBO(bowl_problem(), embedding=Far())
    observe_initial(made)
    assert made.ask(3).x.max() == 1.0


def test_manual_trials_enter_the_fit_but_no_round(optimizer: HdSafeBO) -> None:
    trials = optimizer.ask(2)
    manual = optimizer.observe([[0.45] * 4], [-0.09], [0.24])
    assert manual.round[0] == 0
    assert not manual.initial[0]
    optimizer.tell(trials, *bowl(trials.x))
    assert len(optimizer.surrogate.inputs) == 15
    assert optimizer.ask(1).id[0] == 15


def test_reading_the_model_does_not_change_the_future() -> None:
    made = [HdSafeBO(bowl_problem(), seed=4) for _ in range(2)]
    for one in made:
        observe_initial(one)
        run_rounds(one, 2)
    trials = [one.ask(4) for one in made]
    for i, one in enumerate(made):
        objective, safety = bowl(trials[i].x)
        for row in range(4):
            one.tell(trials[i][[row]], objective[[row]], safety[[row]])
            if i == 0:
                _ = one.surrogate, one.best(), one.feasible
        run_rounds(one, 2)
    assert same(made[0].trials, made[1].trials)


def test_an_ask_that_fails_leaves_no_trace(optimizer: HdSafeBO, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(trials: Trials):
        raise NoSafePointError("no")

    state = optimizer.rng.bit_generator.state
    with monkeypatch.context() as patch:
        patch.setattr(optimizer, "believe", fail)
        with pytest.raises(NoSafePointError):
            optimizer.ask(3)
    assert optimizer.rng.bit_generator.state == state
    assert (len(optimizer.trials), optimizer.round) == (12, 0)


def test_bound_is_missing_where_it_would_have_other_units() -> None:
    safety = Safety("distance", 0.0, transform=lambda g: np.arctan(g))
    problem = FunctionProblem(bowl, bowl_problem().bounds, [safety])
    made = HdSafeBO(problem)
    observe_initial(made)
    trials = made.ask(2)
    assert np.isnan(trials.violation_bound).all()
    assert np.isfinite(trials.predicted_safe_probability).all()


@pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
def test_model_is_a_botorch_model_of_codes() -> None:
    torch = pytest.importorskip("torch")
    made = HdSafeBO(bowl_problem(), embedding=Halving())
    observe_initial(made)
    with torch.no_grad():
        mean = made.model.posterior(torch.from_numpy(made.trials.z)).mean.numpy()
    np.testing.assert_allclose(mean[:, 0], made.trials.objective, atol=0.05)
    np.testing.assert_allclose(mean[:, 1], made.trials.safety[:, 0], atol=0.05)


def test_nothing_to_start_from() -> None:
    with pytest.raises(NoSafePointError, match="no completed trial to start from"):
        HdSafeBO(bowl_problem()).ask(1)
    with pytest.raises(NoSafePointError, match="neither bounds nor initial trials"):
        HdSafeBO(bowl_problem(), embedding=Halving()).ask(1)


def test_rows_need_a_candidate_set(optimizer: HdSafeBO, monkeypatch: pytest.MonkeyPatch) -> None:
    from hdsafebo.optimizers.base import Proposal

    monkeypatch.setattr(optimizer, "propose", lambda n: Proposal(rows=np.array([0])))
    with pytest.raises(ProblemError, match="no candidate set"):
        optimizer.ask(1)
