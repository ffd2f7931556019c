"""Methods by name."""

from dataclasses import fields

import pytest

from hdsafebo.errors import ParamsError, UnknownNameError
from hdsafebo.optimizers.hdsafebo import HdSafeBO
from hdsafebo.optimizers.registry import METHODS, make_optimizer, method_class, method_names
from hdsafebo.problems.knowledge import TaskKnowledge
from optimizers.toy import bowl_problem, observe_initial, rows_problem

METHODS_WITH_VARIANTS = ("linebo", "linebo_lower", "cei", "cei_botorch", "cei_prob", "cei_prob_botorch")


@pytest.mark.parametrize("name", sorted(set(METHODS) - {"random_lowest"}))  # that one needs levels
@pytest.mark.thorough
def test_every_method_takes_a_round(name: str) -> None:
    problem = rows_problem() if name == "thompson_rows" else bowl_problem()
    optimizer = make_optimizer(name, problem, seed=1)
    observe_initial(optimizer, 20)
    assert 1 <= len(optimizer.ask(2)) <= 2


def test_unknown_name_lists_the_valid_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown method 'hdsafeb0'; valid names: .*hdsafebo.*sobol"):
        make_optimizer("hdsafeb0", bowl_problem())


def test_ablations_are_settings_of_the_same_class() -> None:
    for name, key, value in (
        ("hdsafebo", "unit", "box"),
        ("hdsafebo", "perturbed", 20),
        ("hdsafebo", "batch_success", "improved_and_all_safe"),
        ("hdsafebo_printed", "box", "half_width"),
        ("hdsafebo_printed", "perturbed", None),
        ("hdsafebo_printed", "batch_success", "improved"),
        ("hdsafebo_length_scales", "unit", "length_scale"),
        ("hdsafebo_global", "local", False),
        ("hdsafebo_pessimistic", "beta", -2.0),
        ("hdsafebo_beta16", "beta", 16.0),
    ):
        optimizer = make_optimizer(name, bowl_problem())
        assert isinstance(optimizer, HdSafeBO)
        assert getattr(optimizer.settings, key) == value


def test_baselines_have_the_papers_settings_and_variants_beside_them() -> None:
    settings = {
        name: make_optimizer(name, bowl_problem()).settings.model_dump() for name in METHODS_WITH_VARIANTS
    }
    assert (settings["linebo"]["beta"], settings["linebo_lower"]["beta"]) == (2.0, -2.0)
    for name in ("cei", "cei_prob"):
        assert (settings[name]["kernel"], settings[f"{name}_botorch"]["kernel"]) == ("matern52", "rbf")


def test_every_method_says_what_it_uses() -> None:
    names = {field.name for field in fields(TaskKnowledge)}
    for name in METHODS:
        assert method_class(name)[0].uses <= names, name


def test_given_settings_win_over_those_of_the_name() -> None:
    assert make_optimizer("hdsafebo_beta8", bowl_problem(), beta=1.0).settings.beta == 1.0
    with pytest.raises(ParamsError, match="unknown setting"):
        make_optimizer("hdsafebo", bowl_problem(), rounds=3)


def test_names() -> None:
    assert {"hdsafebo", "hdsafebo_local"} <= set(method_names())
    assert method_class("hdsafebo")[0].name == "hdsafebo"
