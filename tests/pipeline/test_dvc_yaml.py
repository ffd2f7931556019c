"""The stages of dvc.yaml name everything that their results depend on."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from hdsafebo.errors import ParamsError
from hdsafebo.files.yaml import read_mapping
from hdsafebo.optimizers.registry import method_names
from hdsafebo.pipeline.checked_params import load_checked_params
from hdsafebo.pipeline.code import CODE, code_files

STAGES = sorted(read_mapping(Path(__file__).parents[2] / "dvc.yaml", ParamsError)["stages"])


@pytest.fixture(scope="module")
def stages(project_root: Path) -> dict[str, dict]:
    return read_mapping(project_root / "dvc.yaml", ParamsError)["stages"]


def script_of(stage: dict) -> str:
    """The stage's script, the word after `python`."""
    words = stage["cmd"].split()
    return words[words.index("python") + 1]


def test_every_stage_depends_on_its_code(stages: dict[str, dict]) -> None:
    for name, stage in stages.items():
        deps = [dep for dep in stage["deps"] if dep.startswith(("src", "stages", CODE))]
        if name == "code":
            assert deps == ["src/hdsafebo", "stages"]
            continue
        expected = [f"{CODE}/stages/{Path(script_of(stage)).stem}.txt"]
        if name.startswith("optimize_"):
            family = name.removeprefix("optimize_")
            expected += [f"{CODE}/tasks/{family}.txt", f"{CODE}/methods/${{item.method}}.txt"]
        assert deps == expected, name


def test_every_code_file_is_written(project_root: Path, stages: dict[str, dict]) -> None:
    params = load_checked_params(project_root / "params.yaml")
    written = code_files(project_root, {name: method.algorithm for name, method in params.methods.items()})
    used = {dep for stage in stages.values() for dep in stage["deps"] if dep.startswith(CODE)}
    used = {dep.removeprefix(f"{CODE}/").removesuffix(".txt") for dep in used if "${" not in dep}
    assert used <= written.keys()
    assert {f"methods/{name}" for name in params.methods} <= written.keys()
    assert written["methods/scbo_original"] == written["methods/scbo"], "one algorithm, two spaces"
    assert stages["code"]["params"] == ["methods"]


def loaded_modules(statement: str) -> set[str]:
    """Modules of the package that Python has loaded after a statement."""
    code = f"{statement}\nimport sys\nprint(*(m for m in sys.modules if m.split('.')[0] == 'hdsafebo'))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize(
    ("name", "statement"),
    [
        ("methods/scbo", "from hdsafebo.optimizers.registry import method_class; method_class('scbo')"),
        ("methods/hdsafebo_local", "from hdsafebo import HdSafeBOLocal"),
        ("tasks/scs", "import hdsafebo.problems.stimulation"),
        ("stages/train_embeddings", "import runpy; runpy.run_path('stages/train_embeddings.py')"),
        ("stages/report", "import runpy; runpy.run_path('stages/report.py')"),
    ],
)
def test_what_python_loads_is_listed(
    project_root: Path, name: str, statement: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Held against the interpreter: nothing that is loaded may be missing from the list."""
    monkeypatch.chdir(project_root)
    source = project_root / "src"
    listed = set()
    for path in code_files(project_root, {name: name for name in method_names()})[name]:
        if path.is_relative_to(source):
            parts = path.relative_to(source).with_suffix("").parts
            listed.add(".".join(parts[:-1] if parts[-1] == "__init__" else parts))
    by_name_only = {"hdsafebo.optimizers.registry", "hdsafebo.optimizers"}
    checked = (
        loaded_modules("import hdsafebo.pipeline.checked_params") if name.startswith("stages") else set()
    )
    assert loaded_modules(statement) - checked - by_name_only <= listed


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
