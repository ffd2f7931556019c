"""Settings are given whole, or by name."""

from inspect import signature
from pathlib import Path

import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.optimizers.baselines.config import ConfigSettings
from hdsafebo.optimizers.hdsafebo import HdSafeBO, HdSafeBOSettings
from hdsafebo.optimizers.registry import METHODS, make_optimizer, method_class
from optimizers.toy import bowl_problem, rows_problem


def test_whole_or_by_name_is_the_same(tmp_path: Path) -> None:
    whole = HdSafeBO(bowl_problem(), settings=HdSafeBOSettings(beta=-1.0, local=False))
    named = HdSafeBO(bowl_problem(), beta=-1.0, local=False)
    assert whole.settings == named.settings
    whole.save(tmp_path / "a")
    named.save(tmp_path / "b")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_name_that_stands_for_settings_takes_what_was_set() -> None:
    made = make_optimizer("hdsafebo_beta4", bowl_problem(), settings=HdSafeBOSettings(local=False))
    assert (made.settings.beta, made.settings.local) == (4.0, False)


@pytest.mark.parametrize("make", [HdSafeBO, lambda *a, **k: make_optimizer("hdsafebo", *a, **k)])
def test_settings_of_another_method_and_settings_given_twice(make) -> None:
    with pytest.raises(ParamsError, match="settings are ConfigSettings; expected HdSafeBOSettings"):
        make(bowl_problem(), settings=ConfigSettings())
    with pytest.raises(ParamsError, match=r"given whole and by name \(beta\)"):
        make(bowl_problem(), settings=HdSafeBOSettings(), beta=1.0)


@pytest.mark.parametrize("name", METHODS)
def test_one_constructor_for_all_methods(name: str) -> None:
    kind, _ = method_class(name)
    shown = set(signature(kind).parameters)
    assert {"problem", "embedding", "seed", "bounds", "settings"} | set(kind.Settings.model_fields) == shown
    assert "__init__" not in vars(kind)
    problem = rows_problem() if "candidate_rows" in kind.uses else bowl_problem()
    assert kind(problem, settings=kind.Settings(beta=-1.0) if kind.consults_model else None).name == kind.name
