"""Posteriors of warped processes: means, gradients, beliefs; the safe set and how far errors inflate it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from hdsafebo.gp.warped_surrogate import SAFETY, WarpedState, WarpedSurrogate, fit_warped_surrogate
from hdsafebo.typing import FloatArray

RNG = np.random.default_rng(3)
X = RNG.random((50, 3))
QUERY = RNG.random((9, 3))


def outcomes(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The first safety function spans orders of magnitude, the second does not."""
    steep = np.sinh(8 * (x[:, 0] - 0.4) + x[:, 1])
    return np.sin(3 * x).sum(axis=1), np.column_stack([steep, 0.8 - x[:, 2]])


def surrogate(inflation: tuple[float, float] = (1.0, 1.0)) -> WarpedSurrogate:
    objective, safety = outcomes(X)
    fitted = fit_warped_surrogate(X, objective, safety, np.zeros(2), best=float(objective.max()))
    return replace(fitted, inflation=np.array(inflation))


@pytest.fixture(scope="module")
def model() -> WarpedSurrogate:
    return surrogate()


def test_predictions_are_near_and_their_deviations_honest(model: WarpedSurrogate) -> None:
    objective, safety = outcomes(QUERY)
    mean, deviation = model.objective.predict(QUERY)
    assert (np.abs(mean - objective) <= 4 * deviation + 1e-3).all()
    means, deviations = model.predict_safety(QUERY)
    assert (np.abs(means - safety) <= 4 * deviations + 1e-3).all()
    np.testing.assert_allclose(model.objective.predict_mean(QUERY), mean)


def test_gradients_are_those_of_the_posterior(model: WarpedSurrogate) -> None:
    posteriors = model.posteriors.believing(QUERY[:2])
    u, step = QUERY[4], 1e-4
    mean, deviation, by_mean, by_deviation = posteriors.at(u)
    many_mean, many_deviation = posteriors.over(u[None])
    np.testing.assert_allclose(many_mean[:, 0], mean, atol=1e-9)
    np.testing.assert_allclose(many_deviation[:, 0], deviation, atol=1e-3)
    for i in range(3):
        move = step * np.eye(3)[i]
        (up, up_sd, *_), (down, down_sd, *_) = posteriors.at(u + move), posteriors.at(u - move)
        np.testing.assert_allclose((up - down) / (2 * step), by_mean[:, i], rtol=1e-3, atol=1e-4)
        # Differences of deviations that are hardly more than rounding say nothing.
        clear = deviation > 2e-3 * posteriors.signal
        slope = (up_sd - down_sd) / (2 * step)
        np.testing.assert_allclose(slope[clear], by_deviation[clear, i], rtol=0.05, atol=2e-3)
        assert clear[0]


def test_the_objective_believes_its_mean_and_the_others_nothing(model: WarpedSurrogate) -> None:
    before, after = model.posteriors, model.posteriors.believing(QUERY[:3])
    means = [p.over(QUERY)[0] for p in (before, after)]
    np.testing.assert_allclose(means[0], means[1])
    (sd_before, safety_before), (sd_after, safety_after) = (
        (p.over(QUERY)[1][0], p.over(QUERY, SAFETY)[1]) for p in (before, after)
    )
    np.testing.assert_allclose(safety_before, safety_after)
    assert (sd_after[:3] < 0.4 * sd_before[:3]).all()
    assert (sd_after <= sd_before + 1e-9).all()
    one_by_one = before.believing(QUERY[:1]).believing(QUERY[1:3])
    np.testing.assert_allclose(one_by_one.over(QUERY)[1], after.over(QUERY)[1], atol=1e-4)
    assert len(after.known) == len(X) + 3


def test_at_the_data_the_posterior_is_the_smoothed_outcome(model: WarpedSurrogate) -> None:
    mean, deviation = model.posteriors.over(X)
    for j, process in enumerate((model.objective, *model.safety)):
        np.testing.assert_allclose(process.smoothed, mean[j], atol=1e-5)
        np.testing.assert_allclose(process.smoothed_deviation, deviation[j], atol=1e-3)


def test_safe_set_is_where_bounds_hold(model: WarpedSurrogate) -> None:
    _, safety = outcomes(QUERY)
    truly = (safety >= 0).all(axis=1)
    believed = model.believed_safe(QUERY, -2.0)
    assert believed.any()
    assert truly[believed].all()
    np.testing.assert_array_equal(believed, model.slack(QUERY, -2.0) >= 0)
    assert (model.safe_probability(QUERY)[believed] > 0.997).all()


def test_errors_make_the_safe_set_smaller_and_the_probability_less_certain(model: WarpedSurrogate) -> None:
    wary = surrogate((20.0, 20.0))
    many = np.random.default_rng(0).random((400, 3))
    assert wary.believed_safe(many, -2.0).sum() < model.believed_safe(many, -2.0).sum()
    assert (wary.believed_safe(many, -2.0) <= model.believed_safe(many, -2.0)).all()
    certain, less = (np.abs(m.safe_probability(many) - 0.5).mean() for m in (model, wary))
    assert less < certain


def test_violation_bound_is_the_expected_violation(model: WarpedSurrogate) -> None:
    draws = np.random.default_rng(0).standard_normal(200_000)
    total = np.zeros(len(QUERY))
    mean, deviation = model.posteriors.over(QUERY, SAFETY)
    for j, process in enumerate(model.safety):
        for i in range(len(QUERY)):
            values = process.outcomes.restore(mean[j, i] + deviation[j, i] * draws)
            total[i] += np.maximum(0.0, -values).mean()
    np.testing.assert_allclose(model.violation_bound(QUERY, None), total, rtol=0.02, atol=1e-4)
    assert (model.violation_bound(QUERY, -2.0) >= model.violation_bound(QUERY, None) - 1e-12).all()


def test_what_is_predicted_of_known_noise_is_the_next_measurement() -> None:
    """Variances of function and measurement add up; the noise is converted where the threshold decides."""
    objective, safety = outcomes(X)
    sd = np.array([0.1, 0.3, 0.05])
    measured = fit_warped_surrogate(
        X, objective, safety, np.zeros(2), best=float(objective.max()), noise=np.tile(sd, (len(X), 1))
    )
    of_function = replace(
        measured, safety=tuple(replace(process, predicted_noise=0.0) for process in measured.safety)
    )
    assert measured.objective.predicted_noise == 0.0, "of the objective the function is looked for"
    mean, deviation = measured.posteriors.over(QUERY, SAFETY)
    plain_mean, plain = of_function.posteriors.over(QUERY, SAFETY)
    np.testing.assert_array_equal(mean, plain_mean)
    for j, process in enumerate(measured.safety):
        near = process.outcomes.apply(np.array([-1e-6, 1e-6]))
        slope = (near[1] - near[0]) / 2e-6
        np.testing.assert_allclose(deviation[j] ** 2 - plain[j] ** 2, (slope * sd[1 + j]) ** 2, rtol=1e-6)
        np.testing.assert_allclose(process.standard_deviation(process.correlation(QUERY)), deviation[j])
    *_, by_deviation = measured.posteriors.at(QUERY[4])
    for i in range(3):
        move = 1e-4 * np.eye(3)[i]
        up, down = (measured.posteriors.at(QUERY[4] + way * move)[1] for way in (1, -1))
        np.testing.assert_allclose((up - down) / 2e-4, by_deviation[:, i], rtol=0.02, atol=1e-4)
    np.testing.assert_allclose(
        measured.safety[0].smoothed_deviation, measured.posteriors.over(X, SAFETY)[1][0], rtol=1e-4
    )
    many = np.random.default_rng(0).random((400, 3))
    assert measured.believed_safe(many, -2.0).sum() < of_function.believed_safe(many, -2.0).sum()
    some_unknown = np.tile(sd, (len(X), 1))
    some_unknown[3, 1] = np.nan
    partly = fit_warped_surrogate(
        X, objective, safety, np.zeros(2), best=float(objective.max()), noise=some_unknown
    )
    assert partly.safety[0].predicted_noise == 0.0 < partly.safety[1].predicted_noise


def test_state_survives_json(model: WarpedSurrogate) -> None:
    state = WarpedState.from_json(json.loads(json.dumps(model.state.to_json(), allow_nan=False)))
    assert state == model.state
