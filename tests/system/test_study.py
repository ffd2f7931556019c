"""Ask, tell, observe, predict and best, by name."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from hdsafebo import Limit, Objective, Real, Study, System
from hdsafebo.errors import NoSafePointError, OptimisticWarning, ParamsError, ProblemError, TrialError
from hdsafebo.system import beliefs
from hdsafebo.system.errors import DescriptionError, TableError
from system.small import (
    box_starts,
    box_study,
    box_system,
    mixed_starts,
    mixed_system,
    run_box,
    run_mixed,
)


@pytest.fixture
def mixed() -> Study:
    """A mixed study with trials under one load."""
    study = Study(mixed_system(), alpha=0.95)
    study.observe(pd.DataFrame(mixed_starts()))
    return study


def test_a_box_is_optimized_within_its_limit() -> None:
    study = box_study()
    for _ in range(20):
        suggestion = study.ask()
        study.tell(suggestion, run_box(suggestion.setting))
    table = study.to_dataframe()
    assert table["safe"].mean() >= 0.95
    best = study.best()
    assert best is not None
    assert best.objective > -2.6, "the best safe gain is -2, at (6, 6)"
    assert float(best.objective) == best.measured.objective == table["gain"][table["safe"]].max()


def test_every_suggestion_can_be_run_and_meets_the_constraints(mixed: Study) -> None:
    for load in (1.0, 1.2, 0.7):
        for _ in range(4):
            suggestion = mixed.ask(context={"load": load})
            setting = suggestion.setting
            assert isinstance(setting["pulses"], int)
            assert setting["pad"] in ("soft", "ribbed", "hard")
            assert setting["angle"] * 2 == round(setting["angle"] * 2)
            assert setting["gap"] == 3
            assert 3 * setting["pulses"] + setting["angle"] <= 40
            assert suggestion.context == {"load": load}
            mixed.tell(suggestion, run_mixed(setting, suggestion.context))
    assert mixed.to_dataframe()["load"].tolist()[20:] == [1.0] * 4 + [1.2] * 4 + [0.7] * 4


def test_predicted_safety_is_of_what_will_be_run(mixed: Study) -> None:
    suggestion = mixed.ask(context={"load": 1.1})
    predicted = mixed.predict(suggestion.setting, context={"load": 1.1})
    assert predicted["safe_probability"][0] == pytest.approx(suggestion.safe_probability, abs=1e-9)


def test_batches_and_tables(mixed: Study) -> None:
    asked = mixed.ask(3, context={"load": 1.0})
    assert len(mixed.pending()) == 3
    results = [run_mixed(row, {"load": 1.0}) for row in asked.to_dict("records")]
    told = pd.DataFrame(results, index=asked.index)[["heat", "grip", "error"]]  # in another order
    mixed.tell(told)
    table = mixed.to_dataframe()
    assert table.loc[asked.index, "heat"].tolist() == [r["heat"] for r in results]
    assert len(mixed.pending()) == 0
    mixed.tell(told)  # once more changes nothing
    with pytest.raises(TrialError, match="first result stays"):
        mixed.tell(told.assign(heat=1.0))


def test_columns_are_found_by_name_never_by_position() -> None:
    rows = pd.DataFrame(box_starts())
    one, other = Study(box_system()), Study(box_system())
    one.observe(rows)
    other.observe(rows[["load", "b", "gain", "a"]])
    pd.testing.assert_frame_equal(one.to_dataframe(), other.to_dataframe())


def test_what_was_really_run_is_on_record(mixed: Study) -> None:
    suggestion = mixed.ask(context={"load": 1.0})
    ran = {"pulses": 2, "frequency": 2.5}
    mixed.tell(suggestion, run_mixed(suggestion.setting | ran, {"load": 1.0}), ran=ran)
    row = mixed.to_dataframe().loc[suggestion.trial]
    assert row["pulses"] == 2
    assert row["frequency"] == pytest.approx(2.5)
    assert row["pad"] == suggestion.setting["pad"]
    other = Study(mixed_system(), alpha=0.95)
    other.observe(mixed_starts())
    believed = other.predict(suggestion.setting | ran, context={"load": 1.0})["safe_probability"][0]
    assert row["safe_probability"] == pytest.approx(believed), "of what was run, before its result was known"
    with pytest.raises(TrialError, match="told before with another x"):
        mixed.tell(suggestion, run_mixed(suggestion.setting | ran, {"load": 1.0}), ran={"pulses": 3})


def test_failed_trials_need_no_fillers_and_teach() -> None:
    study = box_study(12)
    before = study.ask()
    study.tell(before, failed=True, ran={"a": 1.0, "b": 8.0})
    assert study.to_dataframe()["status"].iloc[-1] == "failed"
    failed = {"a": 1.0, "b": 8.0}
    assert study.predict(failed)["completes_safe"][0] < 0.5
    assert study.predict(failed)["safe_probability"][0] < 0.5
    far = box_starts(12)[0]
    assert study.predict({"a": far["a"], "b": far["b"]})["safe_probability"][0] > 0.9
    for _ in range(3):
        suggestion = study.ask()
        assert np.hypot(suggestion.setting["a"] - 1.0, suggestion.setting["b"] - 8.0) > 1.0
        study.tell(suggestion, run_box(suggestion.setting))

    ignoring = Study(box_system(failures="ignored"), alpha=0.95)
    ignoring.observe(box_starts(12))
    again = ignoring.ask()
    ignoring.tell(again, failed=True)
    assert "completes_safe" not in ignoring.predict(again.setting)
    assert ignoring.predict(again.setting)["safe_probability"][0] > 0.9


def test_observed_tables_may_hold_failures() -> None:
    study = Study(box_system())
    rows = pd.DataFrame(box_starts())
    rows["status"] = "completed"
    rows.loc[3, ["gain", "load"]] = np.nan
    rows.loc[3, "status"] = "failed"
    study.observe(rows)
    assert study.to_dataframe()["status"].tolist().count("failed") == 1


def test_signs_are_turned_here_and_nowhere_else(mixed: Study) -> None:
    table, starts = mixed.to_dataframe(), mixed_starts()
    assert table["error"].tolist() == pytest.approx([r["error"] for r in starts])
    assert table["heat"].tolist() == pytest.approx([r["heat"] for r in starts])
    best = mixed.best()
    assert best is not None
    assert best.objective == min(r["error"] for r in starts)
    predicted = mixed.predict({k: starts[0][k] for k in ("frequency", "angle", "pulses", "pad", "load")})
    assert predicted["heat"][0] == pytest.approx(starts[0]["heat"], abs=0.5)
    assert predicted["error"][0] == pytest.approx(starts[0]["error"], abs=0.3)


def test_at_least_and_at_most_of_one_quantity() -> None:
    study = Study(box_system(limits=[Limit("load", at_least=2, at_most=12)]), alpha=0.95)
    ends = [{"a": v, "b": v} | run_box({"a": v, "b": v}) for v in (0.1, 0.4, 9.0, 9.5)]
    study.observe(box_starts() + ends)
    predicted = study.predict({"a": [0.2, 3.0, 9.2], "b": [0.2, 3.0, 9.2]})
    assert predicted["load_safe"][1] > 0.95
    assert predicted["load_safe"][0] < 0.5
    assert predicted["load_safe"][2] < 0.5
    assert study.to_dataframe()["safe"].tolist() == [2 <= r["load"] <= 12 for r in box_starts() + ends]


def test_lists_of_settings() -> None:
    rng = np.random.default_rng(0)
    rows = pd.DataFrame(rng.uniform(0, 10, (60, 2)).round(2), columns=["b", "a"])
    study = Study(box_system(settings=rows), alpha=0.95)
    known = [r for r in rows.to_dict("records") if r["a"] + r["b"] < 8][:8]
    study.observe([r | run_box(r) for r in known])
    seen = {(r["a"], r["b"]) for r in known}
    for _ in range(8):
        suggestion = study.ask()
        place = (suggestion.setting["a"], suggestion.setting["b"])
        assert place in set(zip(rows["a"], rows["b"], strict=True))
        assert place not in seen, "without contexts a row is tried once"
        seen.add(place)
        study.tell(suggestion, run_box(suggestion.setting))
    assert study.to_dataframe()["safe"].mean() > 0.9


def test_a_row_may_be_tried_again_under_another_context() -> None:
    rows = {"a": [1.0, 2.0, 3.0], "b": [1.0, 2.0, 3.0]}
    study = Study(box_system(settings=rows, contexts=[Real("wind", 0, 1)]), alpha=0.6, empty_safe_set="mark")
    study.observe([{"a": v, "b": v, "wind": 0.1 * v} | run_box({"a": v, "b": v}) for v in (1.0, 2.0, 3.0)])
    asked = study.ask(3, context={"wind": 0.4})
    assert sorted(asked["a"]) == [1.0, 2.0, 3.0]
    assert asked["wind"].tolist() == [0.4] * 3
    with pytest.raises(TrialError, match="all 3 candidates"):
        study.ask(context={"wind": 0.4})
    assert len(study.ask(1, context={"wind": 0.3})) == 1
    with pytest.raises(DescriptionError, match=r"rows \[0, 2\] are the same"):
        Study(box_system(settings={"a": [1.0, 2.0, 1.0], "b": [1.0, 2.0, 1.0]}))


def test_contexts_are_kernel_inputs_of_their_own_trials() -> None:
    """Results under one load say what happens under that load, whatever the load is now."""
    study = Study(mixed_system(), alpha=0.95)
    light, heavy = mixed_starts(12, load=0.5), mixed_starts(12, load=4.0)
    study.observe(light + heavy)
    setting = {k: light[0][k] for k in ("frequency", "angle", "pulses", "pad")}
    predicted = study.predict({k: [v] * 2 for k, v in setting.items()} | {"load": [0.5, 4.0]})
    assert predicted["heat"][1] - predicted["heat"][0] == pytest.approx(3 * 3.5, rel=0.1)


def test_a_context_beyond_all_others_is_promised_with_a_larger_margin(mixed: Study) -> None:
    optimizer = mixed.optimizer
    usual = optimizer.model_settings.confidence
    try:
        mixed.ask(context={"load": 1.0})
        assert optimizer.promised_beta == usual
        mixed.ask(context={"load": 1.5})
        assert optimizer.promised_beta < usual - 1
    except NoSafePointError:
        assert optimizer.promised_beta < usual - 1


def test_known_noise_is_the_models_noise() -> None:
    rng = np.random.default_rng(0)
    rows = [r | {"gain": r["gain"] + 2 * rng.standard_normal()} for r in box_starts(30)]
    study = Study(box_system(objective=Objective("gain", noise=2.0)))
    study.observe(rows)
    process = study.optimizer.surrogate.objective
    assert process.noise_variance * process.outcomes.unit**2 >= 4.0 - 1e-9, "of a warped model the least"
    stepped = [Real("a", 0, 10, step=0.01), Real("b", 0, 10)]  # has isotropic models
    plain = Study(box_system(objective=Objective("gain", noise=2.0), parameters=stepped))
    plain.observe(rows)
    gp = plain.optimizer.surrogate.objective
    assert gp.hyper.noise_ratio * gp.signal_deviation**2 == pytest.approx(4.0)
    single = Study(box_system(parameters=stepped))
    single.observe([r | {"gain_noise": 1.0 if i else 5.0} for i, r in enumerate(rows)])
    gp = single.optimizer.surrogate.objective
    np.testing.assert_allclose(gp.noise_ratios * gp.signal_deviation**2, [25.0] + [1.0] * 29)


def test_expected_gain_shrinks_as_the_best_is_found() -> None:
    study = box_study()
    first = study.expected_gain()
    for _ in range(25):
        suggestion = study.ask()
        study.tell(suggestion, run_box(suggestion.setting))
    assert study.expected_gain() < 0.1 * first


def test_from_unsafe_starts_nothing_is_suggested_and_the_message_says_what_to_do() -> None:
    study = Study(box_system(), alpha=0.95)
    study.observe([{"a": v, "b": v} | run_box({"a": v, "b": v}) for v in (7.0, 8.0, 9.0)])
    assert study.best() is None
    with pytest.raises(NoSafePointError, match="report a safe trial"):
        study.ask()
    assert study.safest() is None
    marking = Study(box_system(), alpha=0.95, empty_safe_set="mark")
    marking.observe([{"a": v, "b": v} | run_box({"a": v, "b": v}) for v in (7.0, 8.0, 9.0)])
    assert marking.ask().marked_unsafe


def test_where_nothing_new_is_believed_safe_the_safest_known_trial_is_named() -> None:
    study = Study(box_system(limits=[Limit("load", at_most=12, noise=3.0)]), alpha=0.99)
    study.observe([{"a": 3.0 + 0.1 * i, "b": 3.0, "gain": 0.0, "load": 11.0 - 0.1 * i} for i in range(6)])
    with pytest.raises(NoSafePointError, match=r"believed safe.*trial . is the safest.*to observe") as raised:
        study.ask()
    safest = study.safest()
    assert safest is not None
    assert f"trial {safest.trial} is the safest" in str(raised.value)
    assert str(safest.setting) in str(raised.value)
    known = study.predict(study.to_dataframe()[["a", "b"]])["safe_probability"]
    assert safest.safe_probability == pytest.approx(known.max())


@pytest.mark.parametrize("method", ["cei", "scbo", "safeopt", "cmaes"])
def test_methods_that_cannot_hold_contexts_say_so(method: str) -> None:
    with pytest.raises(ProblemError, match=f"method '{method}' would choose the contexts of 'mixed'"):
        Study(mixed_system(), method=method)


@pytest.mark.parametrize("method", ["hdsafebo", "linebo", "scbo", "cei", "turbo", "cmaes", "sobol"])
def test_every_method_lands_where_it_can_be_run_and_is_judged_there(method: str) -> None:
    promises = method in ("hdsafebo", "linebo", "cei")
    with nullcontext() if promises else pytest.warns(OptimisticWarning, match=f"{method} promises no safety"):
        study = Study(mixed_system(contexts=()), method=method, **({"alpha": 0.9} if promises else {}))
    study.observe([{k: v for k, v in r.items() if k != "load"} for r in mixed_starts()])
    before = study.optimizer.surrogate
    asked = study.ask(3)
    assert (3 * asked["pulses"] + asked["angle"] <= 40).all()
    assert (asked["angle"] * 2 == (asked["angle"] * 2).round()).all()
    x = study.optimizer.trials.x[asked.index]
    believed = before.safe_probability(study.optimizer.kernel_inputs(study.optimizer.trials[asked.index]))
    np.testing.assert_allclose(asked["safe_probability"], believed, atol=1e-9)
    np.testing.assert_array_equal(x, study.optimizer.problem.land(x))
    results = [run_mixed(row, {"load": 1.0}) for row in asked.to_dict("records")]
    study.tell(pd.DataFrame(results, index=asked.index))
    study.ask()


def test_settings_are_checked() -> None:
    with pytest.raises(ParamsError, match="no_such"):
        Study(box_system(), no_such=1)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: s.ask(), "the context lacks 'load'"),
        (lambda s: s.ask(context={"load": 1, "wind": 2}), "the context has 'wind'; expected load"),
        (lambda s: s.ask(context={"load": 9}), "load is 9; expected 0 to 5 kg"),
        (lambda s: s.ask(context={"load": np.nan}), "load is nan"),
        (lambda s: s.tell(0, {"error": 1, "heat": 2}), "results lacks 'grip'"),
        (lambda s: s.tell(0, {"error": 1, "heat": 2, "grip": 3, "colour": 4}), "results has 'colour'"),
        (lambda s: s.tell(0, {"error": 1, "heat": np.nan, "grip": 3}), "heat is nan; .* told as failed"),
        (lambda s: s.tell(0, {"error": 1, "heat": "hot", "grip": 3}), "heat is 'hot'"),
        (lambda s: s.tell(0), "results are missing; expected error, heat, grip"),
        (
            lambda s: s.tell(0, {"error": 1, "heat": 2, "grip": 3}, failed=True),
            "a failed trial has no results",
        ),
        (lambda s: s.tell(0, {"error": 1, "heat": 2, "grip": 3}, ran={"pulses": 9}), "pulses is 9"),
        (lambda s: s.tell(0, {"error": 1, "heat": 2, "grip": 3}, ran={"plses": 2}), "ran has 'plses'"),
        (lambda s: s.tell(0, {"error": 1, "heat": 2, "grip": 3}, noise={"heat": 0}), "heat_noise is 0"),
        (lambda s: s.tell(pd.DataFrame({"error": [1.0]})), "lacks 'trial', 'heat', 'grip'"),
        (lambda s: s.observe(np.zeros((2, 7))), "the table is ndarray; expected a DataFrame"),
        (lambda s: s.observe(mixed_starts(2)[0] | {"pad": "wood"}), "pad is 'wood'; expected one of 'soft'"),
        (lambda s: s.observe([{"frequency": 1.0}]), "the table lacks 'angle'"),
        (lambda s: s.observe(mixed_starts(1)[0] | {"load": 7.0}), "load is 7; expected 0 to 5 kg"),
        (lambda s: s.observe(mixed_starts(1)[0] | {"gap": 4}), "gap is 4; expected the fixed 3"),
        (lambda s: s.observe(mixed_starts(1)[0] | {"status": "good"}), "status is 'good'"),
        (lambda s: s.predict({"frequency": 5.0}), "the table lacks 'angle'"),
        (lambda s: s.best(context={}), "the context lacks 'load'"),
    ],
)
def test_bad_input_is_named_and_nothing_is_recorded(mixed: Study, call, message: str) -> None:
    before, generator = mixed.to_dataframe(), mixed.optimizer.rng.bit_generator.state
    with pytest.raises(TableError, match=message):
        call(mixed)
    pd.testing.assert_frame_equal(mixed.to_dataframe(), before)
    assert mixed.optimizer.rng.bit_generator.state == generator


def test_one_bad_row_takes_none_of_the_table(mixed: Study) -> None:
    rows = mixed_starts(5, seed=3)
    rows[4]["heat"] = float("inf")
    with pytest.raises(TableError, match="row 4: heat is inf"):
        mixed.observe(rows)
    assert len(mixed) == 20


@pytest.mark.parametrize("trial", [float("nan"), None, float("inf"), "8", "x", 8.5, True, np.True_, 10**400])
def test_what_is_no_number_of_a_trial_is_refused_in_words(trial: Any) -> None:
    study = box_study()
    study.ask()
    with pytest.raises(TableError, match="row 0: trial is"):
        study.tell({"trial": [trial], "gain": [1.0], "load": [1.0]})


@pytest.mark.parametrize(
    "given",
    [
        {"results": {"gain": 10**400, "load": 1.0}},
        {"results": {"gain": np.array(1.0), "load": 1.0}},
        {"results": {"gain": 1.0, "load": 1.0}, "noise": [1.0, 2.0]},
        {"results": {"gain": 1.0, "load": 1.0}, "noise": {"gain": 10**400}},
        {"results": {"gain": 1.0, "load": 1.0}, "ran": [1.0, 2.0]},
        {"results": {"gain": 1.0, "load": 1.0}, "ran": {"a": 10**400}},
        {"results": {"gain": 1.0, "load": 1.0, "status": ["completed"]}},
    ],
)
def test_what_is_no_table_of_numbers_is_refused_in_words(given: dict[str, Any]) -> None:
    study = box_study()
    suggestion = study.ask()
    with pytest.raises(TableError):
        study.tell(suggestion, **given)
    study.tell(suggestion, {"gain": 1.0, "load": 1.0})


def test_one_trial_is_not_told_in_two_ways() -> None:
    """Whatever differs: of two inputs or two deviations, neither is known to be right."""
    study = box_study()
    number = study.ask().trial
    twice = {"trial": [number, number], "gain": [1.0, 1.0], "load": [1.0, 1.0]}
    for more in ({"a": [1.0, 2.0]}, {"gain_noise": [0.1, 0.2]}, {"load_noise": [0.1, float("nan")]}):
        with pytest.raises(TrialError, match="one trial is told twice in this call, with different"):
            study.tell(twice | more)
    study.tell(twice | {"a": [1.0, 1.0], "gain_noise": [0.1, 0.1]})
    study.tell(number, {"gain": 1.0, "load": 1.0}, noise={"gain": 0.1})
    study.tell(number, {"gain": 1.0, "load": 1.0})
    for noise in ({"gain": 0.3}, {"load": 0.3}):
        with pytest.raises(TrialError, match="were told before with another noise"):
            study.tell(number, {"gain": 1.0, "load": 1.0}, noise=noise)


def test_a_suggestion_of_another_study_is_not_told_here() -> None:
    """Its number is one of this study's, too: results would go to a setting that was never run."""
    here, there = box_study(seed=0), box_study(seed=1)
    ours, theirs = here.ask(), there.ask()
    assert ours.trial == theirs.trial
    changed = replace(ours, setting=ours.setting | {"a": 9.0})
    for suggestion in (theirs, changed):
        with pytest.raises(TableError, match="tell what was really run as ran"):
            here.tell(suggestion, {"gain": 1.0, "load": 1.0})
    here.tell(changed, {"gain": 1.0, "load": 1.0}, ran={"a": 9.0})
    assert here.to_dataframe().loc[ours.trial, "a"] == 9.0
    here.tell(ours, {"gain": 1.0, "load": 1.0}, ran={"a": 9.0})


def test_every_view_shows_what_was_set_between_steps_and_believes_the_same_of_it() -> None:
    """History, best, safest and `predict` speak of one point: that which was run, not of the nearest step."""
    study = Study(mixed_system(), alpha=0.95)
    study.observe(mixed_starts())
    by_hand = {"frequency": 20.0, "angle": 4.7, "pulses": 4.5, "pad": "ribbed", "load": 1.0}
    study.observe([by_hand | run_mixed(by_hand, by_hand)])
    asked = study.ask(context={"load": 1.0})
    study.tell(asked, run_mixed(asked.setting, {"load": 1.1}), ran={"angle": 0.3, "load": 1.1})

    history = study.to_dataframe()
    for name, value in by_hand.items():
        assert history.loc[20, name] == value
    assert history.loc[asked.trial, "angle"] == pytest.approx(0.3, abs=1e-12)
    again = history.loc[[asked.trial], [*study.system.inputs, *study.system.outcomes]]
    study.tell(again)  # the same result: what is shown is what was told
    stored = beliefs.predict(study.optimizer, study.optimizer.trials.x)
    shown = study.predict(history[[n for n in study.system.inputs if n != "gap"]])
    np.testing.assert_allclose(shown, stored, rtol=0, atol=1e-9)
    for context in (None, {"load": 1.0}):
        best = study.best(context=context)
        assert best is not None
        for view in (best.measured, best.believed, study.safest(context=context)):
            assert view is not None
            row = study.predict([view.setting]).iloc[0]
            seen = [row["error"], row["error_sd"], row["safe_probability"]]
            np.testing.assert_allclose(seen, [view.mean, view.sd, view.safe_probability], atol=1e-9)


@pytest.mark.parametrize(
    ("context", "message"),
    [
        ({"load": [1.0, 4.0]}, "the context has 2 values of 'load'; expected one"),
        ({"load": []}, "the context has 0 values of 'load'; expected one"),
        ([1.0], "the context is list; expected values by name"),
        (1.0, "the context is float; expected values by name"),
    ],
)
def test_a_context_has_one_value_of_each(mixed: Study, context: Any, message: str) -> None:
    """Of two loads the first was taken, and nothing said."""
    setting = {"frequency": 3.0, "angle": 0.0, "pulses": 2, "pad": "soft"}
    for call in (mixed.ask, mixed.best, mixed.safest, mixed.expected_gain):
        with pytest.raises(TableError, match=message):
            call(context=context)
    with pytest.raises(TableError, match=message):
        mixed.predict([setting], context=context)


@pytest.mark.parametrize("ran", [{"angle": [1.0, 2.0]}, {"angle": []}, [1.0]])
def test_what_was_run_instead_has_one_value_of_each(mixed: Study, ran: Any) -> None:
    asked = mixed.ask(context={"load": 1.0})
    with pytest.raises(TableError, match=r"ran (has|is)"):
        mixed.tell(asked, run_mixed(asked.setting, asked.context), ran=ran)
    assert mixed.pending().index.tolist() == [asked.trial]


def test_a_context_is_given_once_and_is_a_context(mixed: Study) -> None:
    setting = {"frequency": 3.0, "angle": 0.0, "pulses": 2, "pad": "soft"}
    with pytest.raises(TableError, match="'load' is in the table and in the context"):
        mixed.predict([setting | {"load": 4.0}], context={"load": 1.0})
    del setting["angle"]
    with pytest.raises(TableError, match="the context has 'angle'"):
        mixed.predict([setting], context={"load": 1.0, "angle": 0.0})


def test_nothing_is_gained_from_a_list_that_was_tried_whole() -> None:
    speeds = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    system = System(
        name="list",
        parameters=[Real("speed", 0.1, 1.5)],
        objective=Objective("way"),
        limits=[Limit("sway", at_most=25)],
        settings={"speed": speeds},
    )
    study = Study(system, alpha=0.9)
    study.observe([{"speed": v, "way": v, "sway": 1 + v} for v in speeds[:-1]])
    assert study.expected_gain() > 0
    study.observe([{"speed": speeds[-1], "way": 0.6, "sway": 1.6}])
    assert study.expected_gain() == 0.0
    with pytest.raises(TrialError, match="all 6 candidates"):
        study.ask()


def test_nothing_is_given_twice(mixed: Study) -> None:
    """Of two values under one name the last was taken, and nothing said."""
    pairs = [("load", 1.0), ("load", 4.0)]
    for context in (pairs, pd.Series([1.0, 4.0], index=["load", "load"])):
        with pytest.raises(TableError, match="the context has 'load' twice"):
            mixed.ask(context=context)
    asked = mixed.ask(context={"load": 1.0})
    results = run_mixed(asked.setting, asked.context)
    with pytest.raises(TableError, match="ran has 'pulses' twice"):
        mixed.tell(asked, results, ran=[("pulses", 2), ("pulses", 3)])
    with pytest.raises(TableError, match="noise of 'heat' is in the results and in `noise`"):
        mixed.tell(asked, results | {"heat_noise": 9.0}, noise={"heat": 0.1})
    with pytest.raises(TableError, match="results has '1' twice"):
        mixed.tell(asked, results | {1: 1.0, "1": 2.0})
    assert mixed.pending().index.tolist() == [asked.trial]
    mixed.tell(asked, results | {"heat_noise": 9.0}, noise={"grip": 0.1})


def test_truth_values_are_no_numbers_and_words_no_truth_values(mixed: Study) -> None:
    """`failed="no"` was taken as failed, and the trial True as trial 1."""
    asked = mixed.ask(context={"load": 1.0})
    with pytest.raises(TableError, match="failed is 'no'; expected True or False"):
        mixed.tell(asked, failed="no")
    for trial in (True, np.True_):
        with pytest.raises(TableError, match=r"trial is .*True"):
            mixed.tell(trial, run_mixed(asked.setting, asked.context))
    mixed.tell(asked, failed=np.True_)
