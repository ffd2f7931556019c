"""Unit cube, codes and the kernel's metric."""

import numpy as np
import pytest

from hdsafebo.errors import ProblemError
from hdsafebo.search.space import SearchSpace

BOUNDS = np.array([[0.0, -1.0, 5.0], [2.0, 0.0, 5.0]])


def test_codes_and_cube_are_inverse_within_the_box() -> None:
    space = SearchSpace(BOUNDS, isotropic=True)
    u = np.random.default_rng(0).random((20, 3))
    z = space.to_code(u)
    np.testing.assert_allclose(space.to_unit(z)[:, :2], u[:, :2])
    np.testing.assert_array_equal(z[:, 2], 5.0)  # a dimension of zero width is fixed
    np.testing.assert_allclose(space.from_kernel_inputs(space.kernel_inputs(u)), u)


def test_isotropic_kernel_distances_are_code_distances_up_to_one_factor() -> None:
    space = SearchSpace(BOUNDS, isotropic=True)
    z = np.random.default_rng(1).uniform(BOUNDS[0], BOUNDS[1], (10, 3))
    k = space.kernel_inputs(space.to_unit(z))
    codes = np.linalg.norm(z[:, None] - z[None], axis=2)
    np.testing.assert_allclose(np.linalg.norm(k[:, None] - k[None], axis=2) * 2.0, codes, atol=1e-12)


def test_without_isotropy_every_width_counts_the_same() -> None:
    space = SearchSpace(BOUNDS, isotropic=False)
    corners = space.kernel_inputs(space.to_unit(BOUNDS))
    np.testing.assert_allclose(corners[1] - corners[0], [1.0, 1.0, 0.0])


def test_rounding_does_not_leave_the_box() -> None:
    bounds = np.array([[0.1], [0.1 + 1e-9]])
    assert SearchSpace(bounds, isotropic=True).to_code(np.array([[1.0]])) <= bounds[1]


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        ([[0.0, 1.0], [1.0, 0.0]], r"lower bound above upper bound .* dimensions \[1\]"),
        ([[0.0, np.nan], [1.0, 1.0]], r"not finite in dimensions \[1\]"),
        ([[1.0, 2.0], [1.0, 2.0]], "zero width in all 2 dimensions"),
        ([[0.0, 1.0]], r"shape \(1, 2\)"),
    ],
)
def test_boxes_that_are_none(bounds: list[list[float]], message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        SearchSpace(np.array(bounds), isotropic=True)
