"""What kernel inputs see of steps in many dimensions."""

from __future__ import annotations

import numpy as np
import pytest

from hdsafebo.errors import ProblemError
from hdsafebo.policies.synergies import ActionSynergies
from hdsafebo.problem import LinearFeatures, Problem, Safety
from hdsafebo.search.metric import Metric, kernel_metric
from hdsafebo.search.row_space import RowSpace
from hdsafebo.search.space import SearchSpace
from hdsafebo.trials import Evaluation, Trials

RNG = np.random.default_rng


def metric(p: int = 3, d: int = 40) -> Metric:
    return Metric(RNG(0).standard_normal((p, d)), np.arange(float(p)))


def test_completed_steps_are_standard_normal_and_show_what_was_drawn() -> None:
    rows = RowSpace.of(metric())
    visible = RNG(1).standard_normal((4000, rows.rank))
    steps = rows.completed(visible, RNG(2))
    np.testing.assert_allclose(steps @ rows.basis.T, visible, atol=1e-9)
    np.testing.assert_allclose(metric().push_forward(steps), visible @ rows.image.T, atol=1e-8)
    covariance = np.cov(steps.T)
    np.testing.assert_allclose(covariance, np.eye(40), atol=0.12)
    np.testing.assert_allclose(steps.mean(axis=0), 0.0, atol=0.08)


def test_a_matrix_of_less_rank_has_fewer_visible_directions() -> None:
    matrix = RNG(0).standard_normal((2, 9))
    rows = RowSpace.of(Metric(np.vstack([matrix, matrix.sum(axis=0)]), np.zeros(3)))
    assert rows.rank == 2
    np.testing.assert_allclose(rows.basis @ rows.basis.T, np.eye(2), atol=1e-10)


def test_the_visible_cube_has_the_kernel_inputs_of_the_space() -> None:
    rows, centre = RowSpace.of(metric()), np.full(40, 0.4)
    small, middle = rows.around(metric().inputs(centre[None])[0])
    np.testing.assert_allclose(small.inputs(middle[None]), metric().inputs(centre[None]), atol=1e-9)
    points = middle + 1e-5 * RNG(4).standard_normal((5, rows.rank))
    steps = rows.lifted(points)
    np.testing.assert_allclose(small.inputs(points), metric().inputs(centre + steps), atol=1e-6)


class Stated(Problem):
    """A box whose features state their matrix, or do not."""

    name = "stated"
    safety = (Safety("safety", 0.0),)

    def __init__(self, *, states: bool, d: int = 30) -> None:
        features = LinearFeatures(RNG(0).standard_normal((4, d)), np.arange(4.0))
        self.features = features if states else features.__call__
        self.bounds = np.stack([-np.linspace(1.0, 2.0, d), np.linspace(0.5, 3.0, d)])

    def evaluate(self, trials: Trials) -> Evaluation:
        raise NotImplementedError


def test_a_stated_matrix_gives_the_metric_that_probing_finds() -> None:
    for embedding, bounds in (
        (None, Stated(states=True).bounds),
        (ActionSynergies(np.eye(2, 6), np.full(30, 0.1)), np.stack([-np.ones(10), np.full(10, 2.0)])),
    ):
        space = SearchSpace(bounds, isotropic=False)
        stated, probed = (kernel_metric(Stated(states=s), embedding, space) for s in (True, False))
        np.testing.assert_allclose(stated.matrix, probed.matrix, atol=1e-12)
        np.testing.assert_allclose(stated.offset, probed.offset, atol=1e-12)


def test_a_stated_matrix_that_is_not_the_features_is_refused() -> None:
    class Wrong(LinearFeatures):
        def __call__(self, x: np.ndarray) -> np.ndarray:
            return 2.0 * super().__call__(x)

    problem = Stated(states=True)
    problem.features = Wrong(RNG(0).standard_normal((4, 30)))
    with pytest.raises(ProblemError, match=r"differ by .* from an affine function"):
        kernel_metric(problem, None, SearchSpace(problem.bounds, isotropic=False))


def test_probing_needs_no_square_matrix() -> None:
    import tracemalloc

    problem = Stated(states=False, d=4000)
    tracemalloc.start()
    kernel_metric(problem, None, SearchSpace(problem.bounds, isotropic=False))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.8 * 4000 * 4000 * 8
