"""What was expected is compared with what came, in units that count the noise of an observation."""

from dataclasses import replace

import numpy as np
import pytest

from hdsafebo.gp.warp import Warp
from hdsafebo.gp.warped_surrogate import SAFETY, WarpedSurrogate, fit_warped_surrogate
from hdsafebo.optimizers.local.constrained.expectations import Expectations

X = np.random.default_rng(0).random((40, 2))
QUERY = np.random.default_rng(1).random((4, 2))


def surrogate(noise: float = 0.0) -> WarpedSurrogate:
    y = X[:, 0] + np.sin(3 * X[:, 1]) + noise * np.random.default_rng(2).standard_normal(40)
    return fit_warped_surrogate(X, y, y[:, None], np.zeros(1), best=float(y.max()))


def missed_by(deviations: float, noise: float = 0.0) -> Expectations:
    """After one trial whose result lies so many expected deviations below the expected one."""
    model, made = surrogate(noise), Expectations(1)
    made.expect(np.array([7]), QUERY[:1], model)
    mean, deviation = model.posteriors.over(QUERY[:1], SAFETY)
    process = model.safety[0]
    spread = np.sqrt(deviation[0, 0] ** 2 + process.noise_variance)
    made.learn(np.array([7]), process.outcomes.restore(mean - deviations * spread))
    return made


@pytest.mark.parametrize(("deviations", "factor"), [(0.5, 1.0), (2.0, 1.0), (6.0, 3.0), (1000.0, 30.0)])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_errors_beyond_the_usual_inflate(deviations: float, factor: float, noise: float) -> None:
    np.testing.assert_allclose(
        missed_by(deviations, noise).inflation(surrogate(noise).safety), factor, rtol=1e-6
    )


def test_noise_that_is_known_by_now_explains_earlier_errors() -> None:
    """Before two trials lie close to each other, no model can know of noise."""
    made = missed_by(20.0)
    assert made.inflation(surrogate().safety)[0] == pytest.approx(10.0)
    noisy = surrogate(0.1)
    assert np.isinf(noisy.safety[0].outcomes.warp.scale)
    assert made.inflation(noisy.safety)[0] < 2.0


def test_noise_explains_earlier_errors_also_under_another_warp() -> None:
    """The same noise, told by a model of warped outcomes, counts as much."""
    made = missed_by(20.0)
    noisy = surrogate(0.1).safety[0]
    warped = replace(noisy, outcomes=replace(noisy.outcomes, warp=Warp(0.0, 0.5)))
    value = made.arrays()["errors"][0, 0, -1]
    slope = 1.0 / np.hypot(value, 0.5)  # of asinh(v / 0.5)
    same = replace(warped, outcomes=replace(warped.outcomes, unit=noisy.outcomes.unit * slope))
    assert made.inflation([same])[0] == pytest.approx(made.inflation([noisy])[0])


def test_old_errors_are_forgotten() -> None:
    made, model = missed_by(6.0), surrogate()
    for number in range(8, 28):
        assert made.inflation(model.safety)[0] == pytest.approx(3.0)
        made.expect(np.array([number]), QUERY[1:2], model)
        made.learn(np.array([number]), model.predict_safety(QUERY[1:2])[0])
    assert made.inflation(model.safety)[0] == 1.0


def test_what_another_version_kept_is_refused() -> None:
    made = missed_by(6.0)
    arrays = made.arrays() | {"errors": made.arrays()["errors"][..., :4]}
    with pytest.raises(ValueError, match=r"errors has shape \(1, 1, 4\)"):
        Expectations(1).restore(arrays)


def test_failed_and_unexpected_trials_teach_nothing() -> None:
    made = Expectations(1)
    made.expect(np.array([3, 4]), QUERY[:2], surrogate())
    made.learn(np.array([3, 99]), np.array([[np.nan], [-1e6]]))
    assert made.inflation(surrogate().safety)[0] == 1.0
    assert made.arrays()["expected_ids"].tolist() == [4]  # the other one is still expected


def test_they_survive_as_arrays() -> None:
    made, model = missed_by(6.0), surrogate()
    made.expect(np.array([9]), QUERY[1:2], model)
    again = Expectations(1)
    again.restore(made.arrays())
    for one in (made, again):
        one.learn(np.array([9]), np.array([[-1e3]]))
    factors = [one.inflation(model.safety) for one in (made, again)]
    np.testing.assert_array_equal(*factors)
    assert factors[0] > 1.0
