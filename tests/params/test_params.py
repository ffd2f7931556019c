"""Parameters: valid profiles load; every bad key ends with a message that names it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import parse_mapping, read_mapping, write_mapping
from hdsafebo.pipeline.checked_params import load_checked_params, parse_checked_params
from hdsafebo.pipeline.profiles import profile_names, profile_text


@pytest.fixture
def standard(project_root: Path) -> dict:
    return read_mapping(project_root / "profiles" / "standard.yaml", ParamsError)


def test_every_profile_is_valid(project_root: Path) -> None:
    for name in profile_names(project_root):
        data = parse_mapping(profile_text(project_root, name), name, ParamsError)
        assert parse_checked_params(data).profile == name


def test_params_are_frozen(standard: dict) -> None:
    params = parse_checked_params(standard)
    with pytest.raises(Exception, match="frozen"):
        params.tasks.synthetic.budget.batch = 3


def set_key(data: dict, key: str, value: object) -> dict:
    *blocks, last = key.split(".")
    block = data
    for name in blocks:
        block = block[name]
    block[last] = value
    return data


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("tasks.synthetic.budget.batch", 0, "greater than or equal to 1"),
        ("tasks.synthetic.budget.batch", "ten", "valid integer"),
        ("tasks.synthetic.budget.batch", 10.0, "valid integer"),
        ("tasks.synthetic.budget.trials", 100, "must exceed initial"),
        ("tasks.synthetic.problem.length_scale", -1.0, "greater than 0"),
        ("tasks.synthetic.problem.length_scale", float("nan"), "finite"),
        ("tasks.synthetic.problem.effective_dimension", 60, "effective_dimension <= latent_dimension"),
        ("tasks.synthetic.problem.colour", 1, "unknown key"),
        ("tasks.synthetic.methods", ["no_such_method"], "has no block under methods"),
        ("tasks.body.problem.least_time", 9.0, "least_time (9 s) must not exceed the horizon (3 s)"),
        ("tasks.body.problem.unseen_pushes", [1, 2], "pushes [1] are among pushes and unseen_pushes"),
        ("tasks.body.problem.pushes", [], "at least 1 item"),
        (
            "tasks.synthetic.methods",
            ["scbo_torques"],
            "'scbo_torques' searches the space 'torques'; expected one of latent, original",
        ),
        ("tasks.scs.tasks", ["scs_biceps"], "^scs_(il|vlrf|ta|bfgm|st|ga)"),
        (
            "methods.no_such_method",
            {},
            "methods.no_such_method: unknown method 'no_such_method'; valid names",
        ),
        ("methods.mine", {"algorithm": "scbo_original"}, "methods.mine: unknown method 'scbo_original'"),
        (
            "methods.scbo.space",
            "inputs",
            "methods.scbo.space: Input should be 'latent', 'original', 'torques'",
        ),
        ("compute.workers", 0, "greater than or equal to 1"),
        ("profile", None, "valid string"),
    ],
)
def test_bad_values_are_named(standard: dict, key: str, value: object, expected: str) -> None:
    with pytest.raises(ParamsError) as caught:
        parse_checked_params(set_key(standard, key, value))
    message = str(caught.value)
    assert expected in message
    assert key.split(".")[-1] in message


@pytest.mark.parametrize(
    "name", ["../../x", "a/b", "/a", "", ".hidden", "-flag", "two words", "line\n", "a\0b", "x" * 81]
)
def test_names_cannot_lead_out_of_a_directory(standard: dict, name: str) -> None:
    """Run files, journals and items of stages are called after the blocks of the methods."""
    standard["methods"][name] = {"algorithm": "sobol"}
    with pytest.raises(ParamsError, match="is no name; expected at most 80 letters, digits") as caught:
        parse_checked_params(standard)
    assert repr(name)[:60] in str(caught.value)
    del standard["methods"][name]
    standard["profile"] = name
    with pytest.raises(ParamsError, match=r"^params: profile: .* is no name"):
        parse_checked_params(standard)


def test_missing_key_is_named(standard: dict) -> None:
    del standard["tasks"]["hand"]["budget"]["initial"]
    with pytest.raises(ParamsError, match=r"tasks\.hand\.budget\.initial: Field required"):
        parse_checked_params(standard)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "- a\n- b\n",
        "a: [1, 2\n",
        "!!python/object/apply:os.system ['echo executed']\n",
        "a: &x [*x]\n",
        "\x00",
    ],
)
def test_files_that_are_no_parameters(tmp_path: Path, text: str, capfd: pytest.CaptureFixture) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(text)
    with pytest.raises(ParamsError, match=r"params\.yaml"):
        load_checked_params(path)
    assert "executed" not in capfd.readouterr().out


@pytest.mark.thorough
def test_a_stage_refuses_bad_params_without_a_traceback(
    project_root: Path, tmp_path: Path, standard: dict
) -> None:
    path = tmp_path / "params.yaml"
    write_mapping(path, set_key(standard, "tasks.synthetic.budget.batch", -1), ParamsError)
    result = subprocess.run(
        [sys.executable, str(project_root / "stages" / "solve_lead_field.py"), "--root", str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 2
    assert "tasks.synthetic.budget.batch" in result.stderr
    assert "-1" in result.stderr
    assert "Traceback" not in result.stderr
