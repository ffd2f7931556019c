"""An edit that any stage would refuse is refused by `hdsafebo check-params`, before hours of other stages."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

from hdsafebo.campaign.run_spec import settings_of
from hdsafebo.cli import main
from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import parse_mapping, read_mapping, write_mapping
from hdsafebo.pipeline.checked_params import parse_checked_params
from hdsafebo.pipeline.checked_settings import check_settings
from hdsafebo.pipeline.profiles import profile_names, profile_text

STANDARD = read_mapping(Path(__file__).parents[2] / "profiles" / "standard.yaml", ParamsError)


def refusal(*keys: str, value: Any) -> str:
    """The message about one changed or added value."""
    data = copy.deepcopy(STANDARD)
    block = data
    for key in keys[:-1]:
        block = block.setdefault(key, {})
    block[keys[-1]] = value
    with pytest.raises(ParamsError) as caught:
        check_settings(parse_checked_params(data), "params.yaml")
    return str(caught.value)


def test_every_profile_passes(project_root: Path) -> None:
    for name in profile_names(project_root):
        data = parse_mapping(profile_text(project_root, name), name, ParamsError)
        check_settings(parse_checked_params(data), name)


@pytest.mark.parametrize("name", STANDARD["methods"])
def test_no_method_takes_an_unknown_setting(name: str) -> None:
    message = refusal("methods", name, "betta", value=2.0)
    assert message.startswith(f"params.yaml: methods.{name}: method ")
    assert "unknown setting 'betta'; valid settings: " in message


@pytest.mark.parametrize("family", STANDARD["tasks"])
def test_no_task_has_an_unknown_setting_of_a_method(family: str) -> None:
    message = refusal("tasks", family, "settings", "sobol", "betta", value=2.0)
    assert f"tasks.{family}.settings.sobol: method 'sobol': unknown setting 'betta'" in message


@pytest.mark.parametrize(
    ("keys", "value", "expected"),
    [
        (("methods", "hdsafebo", "beta"), "two", "methods.hdsafebo: method 'hdsafebo': setting 'beta'"),
        (("methods", "hdsafebo", "beta"), "1:30", "got '1:30'"),
        (("methods", "hdsafebo", "alpha"), 0.9, "methods.hdsafebo: method 'hdsafebo'"),
        (("tasks", "synthetic", "settings", "cmaes_tuned", "step"), -1, "settings.cmaes_tuned: method"),
        (("tasks", "synthetic", "budget", "seeds_of"), {"scbx": 2}, "budget.seeds_of: unknown method 'scbx'"),
        (("tasks", "body", "methods"), ["sobol", "sobol"], "tasks.body.methods: 'sobol' appears twice"),
        (("tasks", "digits", "tasks"), ["digits_3"] * 2, "tasks.digits.tasks: 'digits_3' appears twice"),
        (("tasks", "digits", "methods"), ["cmaes", "cmaes_tuned"], "'cmaes_tuned' is the same run as"),
        (("tasks", "synthetic", "settings", "cmaes_tuned"), {"step": 0.25}, "is the same run as 'cmaes'"),
        (("tasks", "scs", "informed", "settings"), {"cmaes": {"stp": 1}}, "informed.settings.cmaes: method"),
        (("tasks", "scs", "informed", "settings"), {"cmae": {}}, "informed.settings: 'cmae' has no block"),
        (("tasks", "scs", "problem", "embedding"), "irvea", "problem.embedding: unknown embedding 'irvea'"),
        (("isometry", "floors", "irvea"), {}, "isometry.floors: unknown embedding 'irvea'"),
        (("digits", "embedding"), "irvea", "digits.embedding: unknown embedding 'irvea'"),
        (("digits", "embedding_settings", "width"), "wide", "digits.embedding: embedding 'irvae'"),
        (("spinal", "anatomy", "widht_L3"), 9.0, "spinal.anatomy: unknown dimension of"),
        (("spinal", "conductivity", "fatt"), 0.05, "spinal.conductivity: unknown tissue 'fatt'"),
        (("spinal", "districts", "ST"), ["S2", "L5"], "spinal.districts: the district of ST"),
        (("spinal", "districts", "ST"), ["L5", "S9"], "spinal.districts: unknown segment 'S9'"),
    ],
)  # fmt: skip
def test_what_a_later_stage_would_refuse(keys: tuple[str, ...], value: Any, expected: str) -> None:
    assert expected in refusal(*keys, value=value)


def test_the_body_has_no_embedding_to_tell_two_runs_apart() -> None:
    methods = ["hdsafebo_local", "hdsafebo_local_original"]
    message = refusal("tasks", "body", "methods", value=methods)
    assert "'hdsafebo_local_original' is the same run as 'hdsafebo_local'" in message


def test_the_informed_setting_has_settings_of_its_own_which_are_compared_too() -> None:
    data = copy.deepcopy(STANDARD)
    scs = data["tasks"]["scs"]
    scs["methods"] = ["cmaes", "cmaes_tuned"]
    params = parse_checked_params(data)
    check_settings(params, "params.yaml")
    assert settings_of(params, "scs_st", "cmaes_tuned") == {"step": 0.005}
    assert settings_of(params, "scs_st_informed", "cmaes_tuned") == {"step": 0.1}
    scs["informed"]["settings"] = {"cmaes_tuned": {"step": 0.25}}
    with pytest.raises(ParamsError, match="is the same run as 'cmaes' in the informed setting"):
        check_settings(parse_checked_params(data), "params.yaml")


def test_the_command_line_checks_settings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = copy.deepcopy(STANDARD)
    data["methods"]["linebo"]["betta"] = 2.0
    write_mapping(tmp_path / "params.yaml", data, ParamsError)
    with pytest.raises(SystemExit) as end:
        main(["check-params", str(tmp_path / "params.yaml")])
    assert end.value.code == 2
    assert "methods.linebo: method 'linebo': unknown setting 'betta'" in capsys.readouterr().err
