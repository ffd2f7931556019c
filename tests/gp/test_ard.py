"""The closed-form fit against GPyTorch's density and BoTorch's own fit."""

import numpy as np
import pytest

from hdsafebo.errors import SurrogateError
from hdsafebo.gp.ard import BOTORCH_DEFAULT, TRUST_REGION, ArdModel, _loss, correlation, fit_ard

pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")


def data(n: int = 30, d: int = 4, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = rng.random((n, d))
    y = np.sin(5 * x[:, 0]) + x[:, 1] + 0.05 * rng.standard_normal(n)
    return x, (y - y.mean()) / y.std(ddof=1)


@pytest.mark.parametrize("model", [BOTORCH_DEFAULT, TRUST_REGION])
def test_gradient(model: ArdModel) -> None:
    x, y = data()
    theta = np.log([0.5, 0.8, 1.2, 3.0, 0.01, 1.3])
    numeric = [
        (_loss(theta + e, x, y, model)[0] - _loss(theta - e, x, y, model)[0]) / 2e-6 for e in 1e-6 * np.eye(6)
    ]
    np.testing.assert_allclose(_loss(theta, x, y, model)[1], numeric, rtol=1e-6, atol=1e-8)


def test_density_and_optimum_are_those_of_botorch() -> None:
    torch = pytest.importorskip("torch")
    from botorch.fit import fit_gpytorch_mll
    from botorch.models import SingleTaskGP
    from gpytorch.mlls import ExactMarginalLogLikelihood

    x, y = data()
    model = SingleTaskGP(torch.tensor(x), torch.tensor(y)[:, None])
    density = ExactMarginalLogLikelihood(model.likelihood, model)

    def theirs() -> float:
        model.train()
        return float(density(model(*model.train_inputs), model.train_targets).detach())

    fit = fit_ard(x, y, BOTORCH_DEFAULT)
    model.covar_module.lengthscale = torch.tensor(fit.length_scales)
    model.likelihood.noise = torch.tensor(fit.noise)
    model.mean_module.constant = torch.tensor(fit.mean)
    assert fit.log_density == pytest.approx(theirs(), abs=1e-6)
    fit_gpytorch_mll(density)
    assert fit.log_density >= theirs() - 1e-5


def test_start_from_an_earlier_fit_gives_the_same_optimum() -> None:
    x, y = data(60)
    first = fit_ard(x[:50], (y[:50] - y[:50].mean()) / y[:50].std(ddof=1), BOTORCH_DEFAULT)
    cold, warm = fit_ard(x, y, BOTORCH_DEFAULT), fit_ard(x, y, BOTORCH_DEFAULT, start=first)
    assert warm.log_density == pytest.approx(cold.log_density, abs=1e-3)


def test_relevance_is_found() -> None:
    x, y = data(80)
    scales = fit_ard(x, y, TRUST_REGION).length_scales
    assert scales[0] < scales[1] < min(scales[2:])


def test_limits_hold_and_fixed_scale_stays() -> None:
    x, y = data()
    fit = fit_ard(x, y, BOTORCH_DEFAULT)
    assert fit.scale == 1.0
    assert fit.noise >= 1e-4
    assert (fit.length_scales >= 0.025).all()


@pytest.mark.parametrize("kernel", ["rbf", "matern52"])
def test_correlation_decreases_from_one(kernel) -> None:
    values = correlation(np.linspace(0, 9, 50), kernel)
    assert values[0] == 1.0
    assert (np.diff(values) < 0).all()
    assert values[-1] < 0.05


def test_impossible_covariance_is_reported() -> None:
    hopeless = ArdModel("rbf", (1.0, 1.0), (1e-300, 1e-300), (1.0, 1.0))
    with pytest.raises(SurrogateError, match="Cholesky"):
        fit_ard(np.zeros((30, 2)), np.arange(30.0), hopeless)
