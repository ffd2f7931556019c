"""Algorithm 1 line by line, and the open readings of the paper."""

import numpy as np
import pytest

from hdsafebo.optimizers import hdsafebo
from hdsafebo.optimizers.hdsafebo import HdSafeBO
from hdsafebo.problem import FunctionProblem, Safety
from hdsafebo.search.region import TrustRegion
from hdsafebo.trials import Status
from optimizers.toy import bowl, bowl_problem, observe_initial, run_rounds


def made_with(**settings) -> HdSafeBO:
    optimizer = HdSafeBO(bowl_problem(), seed=7, **settings)
    observe_initial(optimizer)
    return optimizer


def drawn(optimizer: HdSafeBO, monkeypatch: pytest.MonkeyPatch) -> list[tuple[np.ndarray, np.ndarray]]:
    """Corners of the boxes that candidates are drawn from while the optimiser is asked once."""
    boxes: list[tuple[np.ndarray, np.ndarray]] = []
    candidates = optimizer._candidates

    def spy(centre, lower, upper):
        boxes.append((lower, upper))
        return candidates(centre, lower, upper)

    with monkeypatch.context() as patch:
        patch.setattr(optimizer, "_candidates", spy)
        optimizer.ask(4)
    return boxes


@pytest.mark.parametrize(("box", "half"), [("side", 0.1), ("half_width", 0.2)])
def test_line_6_box_around_the_best_safe_point(
    monkeypatch: pytest.MonkeyPatch, box: str, half: float
) -> None:
    optimizer = made_with(box=box, unit="box")
    optimizer.region = TrustRegion(0.2)
    centre = optimizer.best().x
    (lower, upper), *_ = drawn(optimizer, monkeypatch)
    np.testing.assert_allclose(lower, np.clip(centre - half, 0, 1))
    np.testing.assert_allclose(upper, np.clip(centre + half, 0, 1))


def test_line_6_in_length_scales(monkeypatch: pytest.MonkeyPatch) -> None:
    optimizer = made_with(unit="length_scale")
    optimizer.region = TrustRegion(0.2)
    (lower, upper), *_ = drawn(optimizer, monkeypatch)
    inside = (lower > 0) & (upper < 1)
    assert inside.any()
    np.testing.assert_allclose((upper - lower)[inside], 0.2 * optimizer.surrogate.length_scale)


def test_lines_7_and_8_sample_only_what_is_believed_safe(monkeypatch: pytest.MonkeyPatch) -> None:
    optimizer = made_with(beta=-1.0)
    seen = []

    def spy(gp, x, n, rng):
        seen.append(x)
        return np.arange(n)

    monkeypatch.setattr(hdsafebo, "thompson_sample", spy)
    optimizer.ask(3)
    mean, deviation = optimizer.surrogate.predict_safety(seen[0])
    assert len(seen[0]) < 2000
    assert (mean[:, 0] - deviation[:, 0] >= 0).all()


def test_too_few_safe_candidates_shrink_the_box(monkeypatch: pytest.MonkeyPatch) -> None:
    """One safe point amid unsafe ones: only its close neighbourhood is believed safe."""
    optimizer = HdSafeBO(bowl_problem(), beta=-2.0, seed=0, unit="box")
    x = np.random.default_rng(0).random((60, 4))
    x[0] = 0.5
    safety = np.full(60, -1.0)
    safety[0] = 1.0
    optimizer.observe(x, x[:, 0], safety, initial=True)
    boxes = drawn(optimizer, monkeypatch)
    sides = np.array([upper[0] - lower[0] for lower, upper in boxes])
    assert len(sides) > 1
    np.testing.assert_allclose(sides, 0.8 / 2.0 ** np.arange(len(sides)))
    asked = optimizer.trials[optimizer.trials.round == 1]
    np.testing.assert_allclose(asked.trust_region_length, sides[-1])
    assert not asked.marked_unsafe.any()
    assert optimizer.region == TrustRegion(0.8)  # shrinking for want of candidates is not SafeUpdate's


@pytest.mark.parametrize(
    ("rule", "objective", "safety", "status", "success"),
    [
        ("improved_and_all_safe", [9.0, -1.0], [1.0, 1.0], [1, 1], True),
        ("improved_and_all_safe", [9.0, -1.0], [1.0, -0.1], [1, 1], False),
        ("improved_and_all_safe", [-1.0, -1.0], [1.0, 1.0], [1, 1], False),  # safe, but no better
        (
            "improved_and_all_safe",
            [9.0, 0.0],
            [1.0, 0.0],
            [1, 2],
            False,
        ),  # a failed trial is not known to be safe
        ("improved", [9.0, -1.0], [1.0, -0.1], [1, 1], True),
        ("improved", [9.0, -1.0], [-0.1, 1.0], [1, 1], False),  # better, but unsafe
    ],
)
def test_line_13_success(rule: str, objective, safety, status, success: bool) -> None:
    optimizer = made_with(batch_success=rule)
    trials = optimizer.ask(2)
    assert optimizer.region == TrustRegion(0.8)
    optimizer.tell(trials, objective, safety, status=np.array(status))
    assert optimizer.region == TrustRegion(0.8, successes=int(success), failures=int(not success))


def test_first_safe_point_is_an_improvement() -> None:
    optimizer = HdSafeBO(bowl_problem(threshold=10.0), batch_success="improved", empty_safe_set="mark")
    observe_initial(optimizer)
    trials = optimizer.ask(1)
    optimizer.tell(trials, [-5.0], [11.0])
    assert optimizer.region.successes == 1


def test_round_ends_with_its_last_result_and_only_then() -> None:
    optimizer = made_with()
    first, second = optimizer.ask(2), optimizer.ask(2)
    optimizer.tell(second[[0]], [9.0], [1.0])
    optimizer.tell(first, [9.5, 9.5], [1.0, 1.0])
    assert optimizer.region.successes == 1
    optimizer.tell(second[[1]], [0.0], [1.0])  # 9.0 no longer improves on 9.5
    assert (optimizer.region.successes, optimizer.region.failures) == (0, 1)


@pytest.mark.parametrize(
    ("batch", "d", "tolerance"), [(10, 50, 5), (1, 4, 4), (1, 2, 4), (4, 4, 1), (10, 16, 2)]
)
def test_failure_tolerance_of_scbo(batch: int, d: int, tolerance: int) -> None:
    assert HdSafeBO(bowl_problem(dimension=d))._rule(batch).failures == tolerance


def test_mask_moves_about_as_many_coordinates_as_asked() -> None:
    optimizer = HdSafeBO(bowl_problem(dimension=40), perturbed=5)
    observe_initial(optimizer, 20)
    centre = np.full(40, 0.5)
    moved = (optimizer._candidates(centre, np.zeros(40), np.ones(40)) != centre).sum(axis=1)
    assert moved.min() >= 1
    assert 4.5 < moved.mean() < 7


def test_number_of_candidates() -> None:
    for d, count in ((4, 2000), (15, 3000), (50, 5000)):
        optimizer = HdSafeBO(bowl_problem(dimension=d))
        assert len(optimizer._candidates(np.full(d, 0.5), np.zeros(d), np.ones(d))) == count


def test_global_ablation_searches_the_whole_box(monkeypatch: pytest.MonkeyPatch) -> None:
    optimizer = made_with(local=False)
    (lower, upper), *more = drawn(optimizer, monkeypatch)
    assert not more
    np.testing.assert_array_equal([lower, upper], [np.zeros(4), np.ones(4)])
    assert np.isnan(optimizer.trials.trust_region_length[-1])


def test_several_safety_functions() -> None:
    def two(x):
        return -((x - 0.6) ** 2).sum(axis=1), np.column_stack(
            [0.5 - x[:, 0], x[:, 1] - 0.2, x[:, 0] * 0 - 1.0]
        )

    safety = [Safety("a", 0.0), Safety("b", 0.0), Safety("shown", -2.0, modelled=False)]
    problem = FunctionProblem(two, bowl_problem().bounds, safety)
    optimizer = HdSafeBO(problem, seed=1, beta=-1.0)
    observe_initial(optimizer, 20)
    run_rounds(optimizer, 10)
    assert len(optimizer.surrogate.safety) == 2
    asked = optimizer.trials[optimizer.trials.round > 0]
    assert problem.is_safe(asked.safety).mean() > 0.9
    assert optimizer.best().objective > -0.02


@pytest.mark.parametrize("beta", [-2.0, 2.0])
@pytest.mark.thorough
def test_finds_the_constrained_optimum(beta: float) -> None:
    """The top of the bowl is 0.4 away from the centre of the safe ball, whose radius is 0.5."""
    optimizer = HdSafeBO(bowl_problem(), beta=beta, seed=3)
    observe_initial(optimizer, 15)
    run_rounds(optimizer, 15)
    assert optimizer.best().objective > -0.01
    asked = optimizer.trials[optimizer.trials.round > 0]
    safe = asked.safety[:, 0] >= 0
    assert safe.mean() > (0.95 if beta < 0 else 0.6)
    assert (optimizer.trials.status == Status.COMPLETED).all()


def test_seed_decides_everything() -> None:
    runs = []
    for seed in (1, 1, 2):
        optimizer = HdSafeBO(bowl_problem(), seed=seed)
        observe_initial(optimizer)
        run_rounds(optimizer, 2)
        runs.append(optimizer.trials.x)
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])
    assert np.isfinite(bowl(runs[0])[0]).all()
