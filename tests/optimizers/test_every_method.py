"""Every method on every toy problem: the contract that all of them share."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

from hdsafebo.errors import NoSafePointError, ParamsError, ProblemError, TrialError
from hdsafebo.optimizers.base import Optimizer
from hdsafebo.optimizers.baselines import cei, hesbo
from hdsafebo.optimizers.registry import METHODS, load_optimizer, make_optimizer, method_class
from hdsafebo.optimizers.settings import CentreSettings, ModelSettings, SafeSetSettings
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.search.acquisition import Acquisition, maximise
from hdsafebo.trials import Status, Trials
from hdsafebo.typing import FloatArray
from optimizers.toy import Halving, bowl_problem, observe_initial, rows_problem

pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")

FIRST_OF_KIND = {(m.module, m.kind): name for name, m in reversed(METHODS.items())}
ROWS_ONLY = {"random_lowest", "thompson_rows"}
"""The controls that choose among the rows of a finite set; their own tests are beside the other controls'."""
NAMES = [
    pytest.param(name, marks=pytest.mark.slow) if name == "cei" else name  # test_cei.py has its fast tests
    for name in reversed(FIRST_OF_KIND.values())
    if name not in ROWS_ONLY
]
OWN_START = {"sobol", "turbo", "hesbo", "baxus", "cmaes", "cmaes_centre", "random_lowest"}
ABSTAIN = {name for name in METHODS if issubclass(method_class(name)[0].Settings, CentreSettings)} - {
    "cmaes_centre"
}
"""The methods that refuse, if told so, to go on without a safe point."""
SAFE_SET = {name for name in METHODS if issubclass(method_class(name)[0].Settings, SafeSetSettings)}
"""The methods whose trials are believed safe, or marked."""
SMALL = {
    "hdsafebo": {"candidates": 200},
    "linebo": {"candidates": 50},
    "scbo": {"candidates": 200},
    "config": {"candidates": 200},
    "turbo": {"candidates": 200},
    "baxus": {"candidates": 200},
    "safeopt": {"grid": 100},
    "hesbo": {"dimension": 2},
}
"""Settings that keep the tests short."""


def three_functions() -> FunctionProblem:
    """Safety functions of which one is modelled through a transform and one is only reported."""

    def function(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        first = 0.3 - ((x - 0.4) ** 2).sum(axis=1)
        return -((x - 0.6) ** 2).sum(axis=1), np.column_stack([first, x[:, 0] + 0.5, x[:, 1]])

    safety = [
        Safety("distance", 0.0),
        Safety("level", 0.6, transform=np.log),
        Safety("shown", 0.05, modelled=False),
    ]
    return FunctionProblem(function, np.stack([np.zeros(3), np.ones(3)]), safety, name="three")


@pytest.fixture(autouse=True)
def short_ascents(monkeypatch: pytest.MonkeyPatch) -> None:
    """Acquisition functions are maximised from one start in three steps: the tests hold of any."""
    for module in (cei, hesbo):
        monkeypatch.setattr(module, "_RAW", 64)
        monkeypatch.setattr(module, "_STARTS", 1)
        monkeypatch.setattr(module, "maximise", few_steps)
    monkeypatch.setattr(cei, "_NEAR", 16)


def few_steps(
    acquisition: Acquisition, starts: FloatArray, lower: FloatArray, upper: FloatArray, steps: int = 50
) -> tuple[FloatArray, float]:
    """`maximise`, in at most three steps."""
    return maximise(acquisition, starts, lower, upper, min(steps, 3))


PROBLEMS = {"box": bowl_problem, "three": three_functions, "rows": rows_problem}


def advance(optimizer: Optimizer, n: int, rounds: int = 1) -> Trials:
    """Ask and tell; the last trials asked."""
    for _ in range(rounds):
        trials = optimizer.ask(n)
        optimizer.tell(trials, *optimizer.problem.function(trials.x))
    return trials


def make(name: str, problem: FunctionProblem, *, seed: int = 0, initial: int = 12, **more) -> Optimizer:
    """A method with its initial data, from outside or its own; it marks what it does not believe safe."""
    kind, fixed = method_class(name)
    if issubclass(kind.Settings, CentreSettings) and fixed.get("start") != "centre":
        more.setdefault("empty_safe_set", "mark")
    optimizer = make_optimizer(
        name, problem, seed=seed, **SMALL.get(METHODS[name].module.rpartition(".")[2], {}), **more
    )
    if getattr(optimizer, "uses_initial_data", True):
        observe_initial(optimizer, initial)
    else:
        advance(optimizer, initial)
    return optimizer


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("problem", PROBLEMS)
@pytest.mark.thorough
def test_proposes_admissible_points_and_learns(name: str, problem: str) -> None:
    optimizer = make(name, PROBLEMS[problem]())
    advance(optimizer, 5, rounds=3)
    trials = optimizer.trials
    assert len(trials) == 12 + 15
    assert np.isfinite(trials.x).all()
    assert (trials.x >= optimizer.problem.bounds[0]).all()
    assert (trials.x <= optimizer.problem.bounds[1]).all()
    if problem == "rows":
        assert len(np.unique(trials.candidate)) == len(trials)
        np.testing.assert_array_equal(optimizer.problem.candidates.inputs(trials.candidate), trials.x)
    believed = np.isfinite(trials[trials.round > 1].predicted_safe_probability)
    assert believed.all() if optimizer.consults_model else not believed.any()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.thorough
def test_an_ask_that_fails_leaves_no_trace(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(trials: Trials):
        raise MemoryError("no memory")

    undisturbed, disturbed = (make(name, three_functions(), seed=4) for _ in range(2))
    for n in (4, 1, 4):
        with monkeypatch.context() as patch:
            patch.setattr(disturbed, "believe", fail)
            with pytest.raises(MemoryError):
                disturbed.ask(n)
        ours, theirs = advance(undisturbed, n), advance(disturbed, n)
        np.testing.assert_array_equal(ours.x, theirs.x)
        np.testing.assert_array_equal(ours.trust_region_length, theirs.trust_region_length)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("problem", ["three", "rows"])
@pytest.mark.thorough
def test_resumed_goes_on_to_the_bit(name: str, problem: str, tmp_path: Path) -> None:
    undisturbed = make(name, PROBLEMS[problem](), seed=3)
    advance(undisturbed, 5)
    open_trials = undisturbed.ask(2)
    undisturbed.save(tmp_path / "state")
    resumed = load_optimizer(name, tmp_path / "state", PROBLEMS[problem]())
    for optimizer in (undisturbed, resumed):
        optimizer.tell(open_trials, *optimizer.problem.function(open_trials.x))
        advance(optimizer, 5, rounds=2)
    for column in ("x", "z", "objective", "predicted_safe_probability", "trust_region_length"):
        ours, theirs = (getattr(optimizer.trials, column) for optimizer in (undisturbed, resumed))
        np.testing.assert_array_equal(ours, theirs, err_msg=column)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.thorough
def test_same_seed_same_trials_other_seed_other_trials(name: str) -> None:
    xs = [advance(make(name, bowl_problem(), seed=seed), 4, rounds=2).x for seed in (1, 1, 2)]
    np.testing.assert_array_equal(xs[0], xs[1])
    if name != "safeopt":  # the safe points known from the start are the same under any seed
        assert not np.array_equal(xs[0], xs[2])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("n", [1, 15])
@pytest.mark.thorough
def test_batches_of_any_size(name: str, n: int) -> None:
    trials = advance(make(name, bowl_problem()), n, rounds=2)
    assert len(trials) == n
    if name != "safeopt":  # it may evaluate a point again
        assert len(np.unique(trials.x, axis=0)) == n


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.thorough
def test_failed_pending_and_partly_told_trials(name: str) -> None:
    optimizer = make(name, bowl_problem())
    function = optimizer.problem.function
    first = optimizer.ask(4)
    second = optimizer.ask(4)  # while the first are under evaluation
    objective, safety = function(first.x)
    objective[1], safety[1] = np.nan, np.nan
    status = np.array([Status.COMPLETED, Status.FAILED, Status.COMPLETED, Status.COMPLETED])
    optimizer.tell(second[[0, 1]], objective=function(second.x[:2])[0], safety=function(second.x[:2])[1])
    optimizer.tell(first, objective, safety, status=status)
    optimizer.tell(second[[2, 3]], np.full(2, np.nan), np.full(2, np.nan), status=Status.FAILED)
    nothing = optimizer.ask(5)
    optimizer.tell(nothing, np.zeros(5), np.zeros(5), status=Status.FAILED)
    assert np.isfinite(advance(optimizer, 5, rounds=2).x).all()
    assert (optimizer.trials.status == Status.FAILED).sum() == 8


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "kind",
    [
        "constant",
        "constant constraint",
        "equal points",
        "duplicated trials",
        "outlier",
        "safety outlier",
        "flat dimension",
        "one dimension",
        "all unsafe",
    ],
)
@pytest.mark.thorough
def test_hostile_data(name: str, kind: str) -> None:
    problem = bowl_problem(
        threshold=10.0 if kind == "all unsafe" else 0.0, dimension=1 if kind == "one dimension" else 4
    )
    if kind == "flat dimension":
        problem.bounds[:, 1] = 0.4
    optimizer = make(name, problem, initial=2)
    x = np.random.default_rng(5).uniform(problem.bounds[0], problem.bounds[1], (30, problem.bounds.shape[1]))
    if kind == "equal points":
        x[:] = x[0]
    if kind == "duplicated trials":
        x[15:] = x[:15]
    objective, safety = problem.function(x)
    if kind == "constant":
        objective = np.full(30, 2.0)
    if kind in ("constant", "constant constraint"):
        safety = np.full((30, 1), 1.0)
    if kind == "outlier":
        objective[3] = 1e12
    if kind == "safety outlier":
        safety[3] = -1e12
    optimizer.observe(x, objective, safety)
    trials = advance(optimizer, 6, rounds=2)
    assert len(trials) == 6
    assert np.isfinite(trials.x).all()


@pytest.mark.parametrize("name", NAMES)
def test_bad_results_are_refused_and_nothing_is_lost(name: str) -> None:
    optimizer = make(name, bowl_problem())
    trials = optimizer.ask(3)
    objective, safety = optimizer.problem.function(trials.x)
    for bad in (
        ([np.nan, 0, 0], [0, 0, 0]),
        ([0, 0, 0], [0, np.inf, 0]),
        ([0, 0], [0, 0]),
        ([0, 0, 0], [[0, 0]] * 3),
    ):
        with pytest.raises(TrialError):
            optimizer.tell(trials, *bad)
    optimizer.tell(trials, objective, safety)
    with pytest.raises(TrialError, match="first result stays"):
        optimizer.tell(trials, objective + 1.0, safety)
    np.testing.assert_array_equal(optimizer.trials.objective[trials.id], objective)
    assert len(advance(optimizer, 3)) == 3


@pytest.mark.parametrize("name", NAMES)
def test_unknown_and_repeated_trials(name: str) -> None:
    optimizer = make(name, bowl_problem())
    trials = optimizer.ask(3)
    objective, safety = optimizer.problem.function(trials.x)
    with pytest.raises(TrialError, match="unknown trials"):
        optimizer.tell([len(optimizer.trials)], [0.0], [0.0])
    first = int(trials.id[0])
    with pytest.raises(TrialError, match="first result stays"):
        optimizer.tell([first, first], [0.0, 1.0], [0.0, 0.0])
    assert not optimizer.trials[trials.id].completed.any()
    optimizer.tell([first, first], objective[[0, 0]], safety[[0, 0]])
    optimizer.tell(trials, objective, safety)
    state = optimizer.rng.bit_generator.state
    optimizer.tell(trials, objective, safety)
    assert optimizer.rng.bit_generator.state == state
    np.testing.assert_array_equal(optimizer.trials.objective[trials.id], objective)


@pytest.mark.parametrize("name", NAMES)
def test_box_without_width(name: str) -> None:
    problem = bowl_problem()
    problem.bounds[:] = 0.4
    with pytest.raises(ProblemError, match="zero width in all 4 dimensions"):
        make_optimizer(name, problem)


@pytest.mark.parametrize("name", NAMES)
def test_no_initial_point_meets_the_threshold(name: str) -> None:
    """The methods that start from a safe point abstain if told so, and lose nothing."""
    abstain = {"empty_safe_set": "abstain"} if name in ABSTAIN else {}
    optimizer = make(name, bowl_problem(threshold=10.0), **abstain)
    known, state = len(optimizer.trials), optimizer.rng.bit_generator.state
    if name in ABSTAIN:
        with pytest.raises(NoSafePointError, match="none of"):
            optimizer.ask(3)
        assert len(optimizer.trials) == known
        assert optimizer.rng.bit_generator.state == state
    else:
        assert len(optimizer.ask(3)) == 3


@pytest.mark.parametrize("name", ["config", "linebo", "safeopt"])  # test_bad_input.py has the other two
def test_batch_larger_than_the_safe_candidates(name: str) -> None:
    """What is missing is marked, or left out; the trials that are believed safe are the same ones."""
    problem = bowl_problem(threshold=0.15)
    marking, abstaining = (
        make(name, problem, beta=-4.0, empty_safe_set=policy, initial=40) for policy in ("mark", "abstain")
    )
    (count,) = SMALL[name].values()  # as many trials as there are candidates
    trials = marking.ask(count)
    assert len(trials) == count
    safe = ~trials.marked_unsafe
    assert 0 < safe.sum() < count
    np.testing.assert_array_equal(abstaining.ask(count).x, trials.x[safe])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.thorough
def test_exhausts_a_finite_set_without_repeating(name: str) -> None:
    optimizer = make(name, rows_problem(n=30), initial=12)
    while len(optimizer.trials) < 30:
        advance(optimizer, 7)
    assert len(np.unique(optimizer.trials.candidate)) == 30
    with pytest.raises(TrialError, match="30 candidates"):
        optimizer.ask(1)


@pytest.mark.parametrize("name", NAMES)
def test_resumes_with_an_embedding(name: str, tmp_path: Path) -> None:
    optimizer = make(name, bowl_problem(), embedding=Halving())
    advance(optimizer, 5, rounds=2)
    optimizer.save(tmp_path / "state")
    resumed = load_optimizer(name, tmp_path / "state", bowl_problem(), Halving())
    np.testing.assert_array_equal(advance(optimizer, 5).x, advance(resumed, 5).x)


@pytest.mark.parametrize("name", NAMES)
def test_unknown_setting_is_named(name: str) -> None:
    with pytest.raises(ParamsError, match="no_such_setting"):
        make_optimizer(name, bowl_problem(), no_such_setting=1)


@pytest.mark.parametrize("name", sorted(set(METHODS) - OWN_START))
def test_without_any_data_the_missing_is_named(name: str) -> None:
    problem = rows_problem() if name in ROWS_ONLY else bowl_problem()
    with pytest.raises(NoSafePointError, match="observe"):
        make_optimizer(name, problem).ask(3)


@pytest.mark.parametrize("name", sorted(ROWS_ONLY))
def test_a_control_of_rows_refuses_a_box(name: str) -> None:
    with pytest.raises(ProblemError, match=f"{name} needs a candidate set"):
        make_optimizer(name, bowl_problem())


def test_random_lowest_draws_the_weakest_rows_only(tmp_path: Path) -> None:
    problem = rows_problem()
    weakest = set(problem.candidates.weakest().tolist())
    optimizer = make("random_lowest", problem)
    advance(optimizer, 5)
    optimizer.save(tmp_path / "state")
    resumed = load_optimizer("random_lowest", tmp_path / "state", problem)
    rows = advance(optimizer, 10, rounds=2).candidate
    np.testing.assert_array_equal(rows, advance(resumed, 10, rounds=2).candidate)
    while not weakest <= set(optimizer.taken.tolist()):
        advance(optimizer, 20)
    assert set(optimizer.trials.candidate[12:].tolist()) <= weakest
    with pytest.raises(TrialError, match="lowest level"):
        optimizer.ask(1)


def test_random_lowest_needs_levels() -> None:
    with pytest.raises(ProblemError, match="weakest"):
        make_optimizer("random_lowest", bowl_problem())


# --- settings


@pytest.mark.parametrize("name", METHODS)
def test_a_setting_that_would_change_nothing_is_unknown(name: str) -> None:
    problem = rows_problem() if name in ROWS_ONLY else bowl_problem()
    for setting, value, known in (
        ("empty_safe_set", "abstain", name in ABSTAIN),
        ("beta", -1.0, issubclass(method_class(name)[0].Settings, ModelSettings)),
    ):
        if known:
            assert getattr(make_optimizer(name, problem, **{setting: value}).settings, setting) == value
        else:
            with pytest.raises(ParamsError, match=setting):
                make_optimizer(name, problem, **{setting: value})


@pytest.mark.parametrize("name", NAMES)
def test_every_setting_is_read(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that nobody reads in three rounds, the second of them of a single trial, is ignored."""
    kind, _ = method_class(name)
    read: set[str] = set()

    class Watched(kind.Settings):
        def __getattribute__(self, key: str) -> Any:
            read.add(key)
            return super().__getattribute__(key)

    monkeypatch.setattr(kind, "Settings", Watched)
    optimizer = make(name, bowl_problem())
    for n in (5, 1, 5):
        advance(optimizer, n)
    assert set(Watched.model_fields) <= read


# --- what is believed of a trial is what will be evaluated


class Inexact(Halving):
    """Its encoder misses a code by some millionths, as those of single precision do."""

    def encode(self, x: FloatArray) -> FloatArray:
        return x / 2 * (1 + 9e-6)


PLACES: dict[str, tuple[Callable[[], FunctionProblem], Halving | None]] = {
    "box": (bowl_problem, None),
    "three": (three_functions, None),
    "rows": (rows_problem, None),
    "embedded": (bowl_problem, Halving()),
    "few rows": (lambda: rows_problem(80), None),
    "inexact": (bowl_problem, Inexact()),
}


@pytest.mark.parametrize("name", sorted(SAFE_SET.intersection(FIRST_OF_KIND.values()) - {"cei"}))
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("policy", ["mark", "abstain"])
@pytest.mark.thorough
def test_unmarked_trials_are_believed_safe_where_they_will_be_evaluated(
    name: str, place: str, policy: str
) -> None:
    make_problem, embedding = PLACES[place]
    if name in ROWS_ONLY and "rows" not in place:
        pytest.skip("chooses among rows")
    optimizer = make(name, make_problem(), embedding=embedding, beta=-1.5, empty_safe_set=policy, initial=20)
    asked = 0
    for n in (6, 1, 6):
        try:
            trials = optimizer.ask(n)
        except NoSafePointError:
            assert policy == "abstain"
            continue
        asked += len(trials)
        believed = optimizer.surrogate.believed_safe(optimizer.kernel_inputs(trials), optimizer.confidence)
        if name == "safeopt":  # evaluates points again that were safe
            believed |= (
                (np.abs(trials.x[:, None] - optimizer.trials.x[optimizer.feasible]) < 1e-8)
                .all(axis=2)
                .any(axis=1)
            )
        assert (believed | trials.marked_unsafe).all()
        if policy == "abstain":
            assert believed.all()
        np.testing.assert_array_equal(trials.id, optimizer.trials.id[-len(trials) :])
        optimizer.tell(trials, *optimizer.problem.function(trials.x))
    assert asked > 0 or policy == "abstain"


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("problem", ["box", "rows"])
def test_a_pending_trial_is_not_proposed_again(name: str, problem: str) -> None:
    optimizer = make(name, PROBLEMS[problem]())
    x = np.vstack([optimizer.ask(1).x for _ in range(5)])
    apart = np.linalg.norm(x[:, None] - x, axis=2) + 10.0 * np.eye(5)
    assert apart.min() > 1e-6


# --- interrupts


@contextmanager
def interrupted(after: float) -> Iterator[list[int]]:
    """Ctrl-C at line number `after` of this package's that is run; yields the number of lines so far."""
    lines = [0]

    def watch(frame: FrameType, event: str, argument: Any) -> Any:
        if "hdsafebo" not in frame.f_code.co_filename:
            return None
        if event == "line":
            lines[0] += 1
            if lines[0] == after:
                raise KeyboardInterrupt
        return watch

    before = sys.gettrace()
    sys.settrace(watch)
    try:
        yield lines
    finally:
        sys.settrace(before)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.thorough
def test_tell_interrupted_at_twenty_points_and_repeated_is_undisturbed(name: str) -> None:
    undisturbed, disturbed = (make(name, three_functions(), seed=4) for _ in range(2))
    for optimizer in (undisturbed, disturbed):
        advance(optimizer, 5)
    trials, same = undisturbed.ask(5), disturbed.ask(5)
    results = undisturbed.problem.function(trials.x)
    with interrupted(np.inf) as lines:
        undisturbed.tell(trials, *results)
    for after in np.linspace(1, lines[0], 20).astype(int):
        with pytest.raises(KeyboardInterrupt), interrupted(after):
            disturbed.tell(same, *results)
        told = disturbed.trials.completed[same.id]
        assert told.all() or not told.any()
        if told.all():  # interrupted after it was all done
            break
    disturbed.tell(same, *results)
    for optimizer in (undisturbed, disturbed):
        advance(optimizer, 4, rounds=2)
    for column in ("x", "z", "objective", "predicted_safe_probability", "trust_region_length"):
        ours, theirs = (getattr(optimizer.trials, column) for optimizer in (undisturbed, disturbed))
        np.testing.assert_array_equal(ours, theirs, err_msg=column)
    assert undisturbed.rng.bit_generator.state == disturbed.rng.bit_generator.state
