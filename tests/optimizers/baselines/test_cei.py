"""Constrained expected improvement against BoTorch's own acquisition functions."""

import numpy as np
import pytest

from hdsafebo.optimizers.baselines.cei import Cei, CeiProb, constrained_improvement, default_models
from optimizers.toy import bowl_problem, observe_initial, run_rounds

pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")


@pytest.mark.parametrize("kernel", ["matern52", "rbf"])
def test_value_is_that_of_botorch(kernel: str) -> None:
    torch = pytest.importorskip("torch")
    from botorch.acquisition.analytic import LogConstrainedExpectedImprovement

    optimizer = CeiProb(bowl_problem(), seed=0, kernel=kernel)
    observe_initial(optimizer, 20)
    processes, best = optimizer._processes(), float(optimizer.best().objective)
    q = np.random.default_rng(0).random((10, 4))
    theirs = LogConstrainedExpectedImprovement(default_models(processes), best, 0, {1: (0.0, None)})
    value = theirs(torch.from_numpy(q)[:, None]).detach().numpy()
    np.testing.assert_allclose(constrained_improvement(processes, best)(q)[0], value, rtol=1e-4, atol=1e-4)


def test_gradient() -> None:
    optimizer = CeiProb(bowl_problem(), seed=0)
    observe_initial(optimizer, 20)
    acquisition = constrained_improvement(optimizer._processes(), -0.1)
    q = np.random.default_rng(0).random((5, 4))
    gradient = acquisition(q)[1]
    for j in range(4):
        e = 1e-5 * np.eye(4)[j]
        numeric = (acquisition(q + e)[0] - acquisition(q - e)[0]) / 2e-5
        np.testing.assert_allclose(gradient[:, j], numeric, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("kind", [CeiProb, Cei])
@pytest.mark.thorough
def test_finds_the_constrained_optimum(kind) -> None:
    """The best safe point of the bowl lies on the sphere of radius 1/2 about 0.4, or at 0.6 within it."""
    optimizer = kind(bowl_problem(), seed=0)
    observe_initial(optimizer, 10)
    for _ in range(3):
        if optimizer.best().objective < -1e-2:
            run_rounds(optimizer, 1, 4)
    assert optimizer.best().objective > -1e-2


@pytest.mark.parametrize("kind", [CeiProb, Cei])
@pytest.mark.thorough
def test_seeks_feasibility_first(kind) -> None:
    optimizer = kind(bowl_problem(threshold=0.2), seed=0, empty_safe_set="mark")
    x = np.random.default_rng(1).uniform(0.7, 1.0, (15, 4))
    optimizer.observe(x, *optimizer.problem.function(x), initial=True)
    assert optimizer.best() is None
    for _ in range(4):
        if optimizer.best() is None:
            run_rounds(optimizer, 1, 4)
    assert optimizer.best() is not None


@pytest.mark.thorough
def test_same_seed_same_batch() -> None:
    batches = []
    for _ in range(2):
        optimizer = Cei(bowl_problem(), seed=4)
        observe_initial(optimizer, 10)
        batches.append(optimizer.ask(2).x)
    np.testing.assert_array_equal(*batches)
