"""The Matern-5/2 kernel against its formula, its gradient and its spectral density."""

import numpy as np
from scipy.integrate import quad

from hdsafebo.gp.kernel import (
    exact_distances,
    fast_distances,
    matern52,
    matern52_with_slope,
    spectral_frequencies,
)


def test_values_follow_the_formula() -> None:
    r = np.array([[0.0, 0.1, 1.0, 7.0]])
    a = np.sqrt(5.0) * r / 0.4
    np.testing.assert_allclose(matern52(r, 0.4), (1 + a + a**2 / 3) * np.exp(-a), rtol=1e-13)


def test_infinite_distance_gives_zero_and_no_warning() -> None:
    np.testing.assert_array_equal(matern52(np.array([[1e200, np.inf]]), 1.0), 0.0)


def test_slope_is_the_gradient() -> None:
    rng = np.random.default_rng(0)
    x, centre, step = rng.random(4), rng.random((1, 4)), 1e-6
    k, slope = matern52_with_slope(exact_distances(x[None], centre), 0.7)
    np.testing.assert_allclose(k, matern52(exact_distances(x[None], centre), 0.7), rtol=1e-13)
    for i in range(4):
        ends = [x + s * step * np.eye(4)[i] for s in (1, -1)]
        high, low = (matern52(exact_distances(end[None], centre), 0.7)[0, 0] for end in ends)
        np.testing.assert_allclose((high - low) / (2 * step), slope[0, 0] * (x - centre[0])[i], rtol=1e-6)


def test_fast_distances_agree() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.random((30, 50)), rng.random((40, 50))
    np.testing.assert_allclose(fast_distances(a, b), exact_distances(a, b), atol=1e-7)


def test_exact_distances_do_not_depend_on_their_neighbours() -> None:
    x = np.random.default_rng(2).random((60, 33))
    whole = exact_distances(x, x)
    np.testing.assert_array_equal(whole, whole.T)
    for size in (1, 7, 31):
        np.testing.assert_array_equal(
            whole, np.concatenate([exact_distances(x[i : i + size], x) for i in range(0, 60, size)])
        )


def test_frequencies_give_the_kernel_as_characteristic_function() -> None:
    rng = np.random.default_rng(3)
    omega = spectral_frequencies(200_000, 3, 0.5, rng)
    for r in (0.1, 0.5, 1.0):
        estimate = np.cos(omega @ np.array([r, 0.0, 0.0]))
        exact = matern52(np.array([[r]]), 0.5)[0, 0]
        assert abs(estimate.mean() - exact) < 4 * estimate.std() / np.sqrt(len(estimate))


def test_density_of_one_frequency_is_student_t() -> None:
    """The Fourier integral of the t density with 5 degrees of freedom is the kernel (dimension one)."""
    from scipy.stats import t

    value, _ = quad(lambda w: np.cos(w * 0.6) * t.pdf(w, 5), -np.inf, np.inf, limit=400)
    np.testing.assert_allclose(value, matern52(np.array([[0.6]]), 1.0)[0, 0], rtol=1e-6)
