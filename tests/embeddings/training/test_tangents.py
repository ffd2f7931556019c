"""The tangent and cotangent pass against automatic differentiation, the distortion against closed forms."""

import numpy as np
import pytest
import torch

from hdsafebo.embeddings.mlp import forward
from hdsafebo.embeddings.training.tangents import TrainableMlp, relaxed_distortion


@pytest.fixture
def mlp() -> TrainableMlp:
    made = TrainableMlp([3, 7, 8, 5], torch.Generator().manual_seed(0))
    made.weights = [w.detach().double().requires_grad_() for w in made.weights]
    made.biases = [b.detach().double().requires_grad_() for b in made.biases]
    return made


@pytest.fixture
def points() -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    z, v = torch.randn(2, 6, 3, generator=generator, dtype=torch.float64)
    return z, v


pytestmark = pytest.mark.filterwarnings(
    "ignore:`torch.jit.script` is deprecated:DeprecationWarning"  # raised within torch.func itself
)


def reference(mlp: TrainableMlp, z: torch.Tensor, v: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """J v and J'J v by torch.func."""

    def single(point: torch.Tensor) -> torch.Tensor:
        return mlp(point[None])[0]

    def both(point: torch.Tensor, direction: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        tangent = torch.func.jvp(single, (point,), (direction,))[1]
        return tangent, torch.func.vjp(single, point)[1](tangent)[0]

    tangents, cotangents = torch.func.vmap(both)(z, v)
    return tangents, cotangents


def test_pass_equals_automatic_differentiation(
    mlp: TrainableMlp, points: tuple[torch.Tensor, torch.Tensor]
) -> None:
    z, v = points
    pullback = mlp.pullback(z, v)
    tangent, cotangent = reference(mlp, z, v)
    torch.testing.assert_close(pullback.value, mlp(z))
    torch.testing.assert_close(pullback.tangent, tangent)
    torch.testing.assert_close(pullback.cotangent, cotangent)


def test_gradients_of_the_distortion_equal_automatic_differentiation(
    mlp: TrainableMlp, points: tuple[torch.Tensor, torch.Tensor]
) -> None:
    z, v = points
    ours = relaxed_distortion(*mlp.pullback(z, v)[1:])
    theirs = relaxed_distortion(*reference(mlp, z, v))
    # the last bias moves the value, not the Jacobian
    trained = mlp.parameters[:-1]
    for one, other in zip(
        torch.autograd.grad(ours, trained), torch.autograd.grad(theirs, trained), strict=True
    ):
        torch.testing.assert_close(one, other)


def test_distortion_is_least_for_scaled_isometries_and_blind_to_scale() -> None:
    generator = torch.Generator().manual_seed(2)
    basis = torch.linalg.qr(torch.randn(20, 4, generator=generator, dtype=torch.float64))[0]
    v = torch.randn(200_000, 4, generator=generator, dtype=torch.float64)

    def distortion(jacobian: torch.Tensor) -> float:
        tangent = v @ jacobian.T
        return float(relaxed_distortion(tangent, tangent @ jacobian))

    stretched = basis * torch.tensor([1.0, 1.0, 1.0, 3.0], dtype=torch.float64)
    assert distortion(basis) == pytest.approx(1 / 4, rel=0.01)
    assert distortion(7 * basis) == pytest.approx(distortion(basis), rel=1e-9)
    # H = diag(1, 1, 1, 9): tr H^2 / (tr H)^2 = 84 / 144
    assert distortion(stretched) == pytest.approx(84 / 144, rel=0.02)


def test_trained_layers_give_the_same_in_numpy() -> None:
    mlp = TrainableMlp([3, 7, 8, 5], torch.Generator().manual_seed(0))
    x = np.random.default_rng(0).standard_normal((9000, 3))
    with torch.no_grad():
        expected = mlp(torch.from_numpy(x.astype(np.float32))).numpy()
    np.testing.assert_allclose(forward(mlp.layers(), x), expected, atol=1e-5)
    assert forward(mlp.layers(), np.empty((0, 3))).shape == (0, 5)
    assert np.isfinite(forward(mlp.layers(), np.full((1, 3), 1e6))).all()
