"""The BoTorch model has the posterior of the fast path, and works with BoTorch's acquisition functions."""

import numpy as np
import pytest

from hdsafebo.gp.surrogate import fit_surrogate
from hdsafebo.optimizers.export.botorch_model import to_botorch
from hdsafebo.search.space import SearchSpace

pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
SPACE = SearchSpace(np.array([[0.0, -5.0], [1.0, 15.0]]), isotropic=True)


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(0)
    z = rng.uniform(SPACE.bounds[0], SPACE.bounds[1], (30, 2))
    k = SPACE.kernel_inputs(SPACE.to_unit(z))
    safety = np.column_stack([z[:, 0] + 0.1 * z[:, 1], 1e4 * np.cos(z[:, 1])])
    return z, fit_surrogate(k, 100 + np.sin(z[:, 1]), safety, np.zeros(2))


@pytest.mark.parametrize("space", [SPACE, None])
def test_posterior_is_the_fast_one(data, space) -> None:
    torch = pytest.importorskip("torch")
    _, surrogate = data
    z = np.random.default_rng(1).uniform(SPACE.bounds[0], SPACE.bounds[1], (7, 2))
    k = SPACE.kernel_inputs(SPACE.to_unit(z))
    model = to_botorch(surrogate, space)
    assert model.num_outputs == 3
    with torch.no_grad():
        posterior = model.posterior(torch.from_numpy(k if space is None else z))
    for j, gp in enumerate((surrogate.objective, *surrogate.safety)):
        mean, deviation = gp.predict(k)
        np.testing.assert_allclose(posterior.mean[:, j].numpy(), mean, atol=1e-5 * gp.signal_deviation)
        np.testing.assert_allclose(
            posterior.variance[:, j].sqrt().numpy(), deviation, rtol=1e-3, atol=1e-6 * gp.signal_deviation
        )


def test_acquisition_functions_of_botorch_run_on_it(data) -> None:
    torch = pytest.importorskip("torch")
    from botorch.acquisition.analytic import LogConstrainedExpectedImprovement
    from botorch.optim import optimize_acqf

    _, surrogate = data
    acquisition = LogConstrainedExpectedImprovement(
        to_botorch(surrogate, SPACE),
        best_f=100.5,
        objective_index=0,
        constraints={1: (0.0, None), 2: (0.0, None)},
    )
    torch.manual_seed(0)
    point, value = optimize_acqf(
        acquisition, torch.from_numpy(SPACE.bounds), q=1, num_restarts=2, raw_samples=32
    )
    assert torch.isfinite(value)
    assert (point.numpy() >= SPACE.bounds[0]).all()
    assert (point.numpy() <= SPACE.bounds[1]).all()
