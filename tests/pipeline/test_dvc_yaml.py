"""The stages of dvc.yaml name everything that their results depend on."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
import yaml

from hdsafebo.pipeline.checked_params import load_checked_params
from hdsafebo.pipeline.imports import used_modules

STAGES = sorted(yaml.safe_load((Path(__file__).parents[2] / "dvc.yaml").read_text())["stages"])


@pytest.fixture(scope="module")
def stages(project_root: Path) -> dict[str, dict]:
    return yaml.safe_load((project_root / "dvc.yaml").read_text())["stages"]


def script_of(stage: dict) -> str:
    """The stage's script, the word after `python`."""
    words = stage["cmd"].split()
    return words[words.index("python") + 1]


# Modules that a stage loads by the names in a registry, which its imports do not show.
LOADED_BY_NAME = {
    "optimize_synthetic": ["problems/synthetic.py", "optimizers/*.py"],
    "optimize_hand": ["problems/hand.py", "optimizers/*.py"],
    "optimize_scs": ["problems/stimulation.py", "optimizers/*.py", "embeddings/*.py"],
    "optimize_digits": ["problems/digits.py", "optimizers/*.py", "embeddings/*.py"],
    "train_embeddings": ["embeddings/*.py"],
    "check_isometry": ["embeddings/*.py"],
    "train_digits": ["embeddings/*.py"],
}


def modules_of(name: str, stage: dict, root: Path) -> set[Path]:
    """Everything of the package that a stage uses."""
    package = root / "src" / "hdsafebo"
    by_name = {path for pattern in LOADED_BY_NAME.get(name, []) for path in package.glob(pattern)}
    return used_modules([root / script_of(stage), *by_name], root / "src") | by_name


@pytest.mark.parametrize("name", STAGES)
def test_every_used_module_is_among_the_deps(project_root: Path, stages: dict[str, dict], name: str) -> None:
    stage = stages[name]
    listed = [project_root / dep for dep in stage["deps"] if "${" not in dep]
    used = modules_of(name, stage, project_root)
    assert used, "the script uses nothing of the package"
    missing = {
        str(path.relative_to(project_root))
        for path in used
        if not any(path == dep or dep in path.parents for dep in listed)
    }
    assert not missing


@pytest.mark.parametrize("name", STAGES)
def test_no_dep_is_needless_or_gone(project_root: Path, stages: dict[str, dict], name: str) -> None:
    used = modules_of(name, stages[name], project_root)
    for dep in stages[name]["deps"]:
        if dep.startswith("src/") and "${" not in dep:
            path = project_root / dep
            assert path.exists(), f"{dep} does not exist"
            assert any(path == file or path in file.parents for file in used), f"{dep} is not used"


@pytest.mark.parametrize("name", STAGES)
def test_the_script_is_its_own_dep(stages: dict[str, dict], name: str) -> None:
    assert script_of(stages[name]) in stages[name]["deps"]


def test_every_output_is_made_by_one_stage(stages: dict[str, dict]) -> None:
    outs = [out for stage in stages.values() for out in stage.get("outs", []) if "${" not in out]
    assert len(outs) == len(set(outs))


@pytest.mark.parametrize("name", STAGES)
def test_params_that_a_script_reads_are_listed(
    project_root: Path, stages: dict[str, dict], name: str
) -> None:
    """`stage.params.block` in a script needs `block` (or a part of it) in the stage's params."""
    tree = ast.parse((project_root / script_of(stages[name])).read_text())
    read = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Attribute)
        and node.value.attr == "params"
    }
    listed = {key.split(".")[0] for key in stages[name].get("params", [])}
    assert read - {"compute", "tracking", "profile"} <= listed


def test_the_matrices_are_the_tasks_and_methods_of_the_params(project_root: Path) -> None:
    params = load_checked_params(project_root / "params.yaml")
    for _family, task in params.tasks:
        assert len(set(task.methods)) == len(task.methods)
