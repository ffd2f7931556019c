"""What determines a run: plain data, and the identity under which its rounds are kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

import hdsafebo
from hdsafebo.errors import ParamsError
from hdsafebo.optimizers.registry import method_module
from hdsafebo.params import Budget, Params, parse_params
from hdsafebo.params.base import MethodSettings
from hdsafebo.pipeline.code import modules_behind
from hdsafebo.pipeline.imports import ImportGraph
from hdsafebo.pipeline.provenance import digest_file, digest_paths
from hdsafebo.problems.registry import family_of, is_informed, task_module

# Blocks of params.yaml that a family of tasks reads, beside its own block under `tasks`.
_BLOCKS = {
    "synthetic": (), "hand": ("hand",), "body": (), "scs": ("spinal", "embeddings"), "digits": ("digits",),
}  # fmt: skip
# Modules that compute runs but no trial: a change of these leaves what was computed as it is.
_INDIFFERENT_MODULES = {
    "progress.py", "errors.py",
    "campaign/cluster.py", "campaign/errors.py", "campaign/journal.py", "campaign/progress.py",
    "files/atomic.py", "pipeline/code.py", "pipeline/imports.py", "pipeline/provenance.py",
}  # fmt: skip
_LIBRARIES = ("numpy", "scipy", "torch", "gpytorch", "botorch", "scikit-learn", "mujoco", "numba", "cma")
_INITIAL_STREAM, _METHOD_STREAM = 1, 2


@dataclass(frozen=True)
class RunSpec:
    """One run of a campaign.

    Attributes:
        task: name of the task.
        method: name of the method's block in the parameters.
        seed: of the problem, the initial trials and the method.
        params: the whole of `params.yaml` as plain data.
        root: directory below which files of the task lie.
        progress: directory for signs of life, shared by the runs of a campaign.
        home: directory below which the journal lies; None takes the root.
    """

    task: str
    method: str
    seed: int
    params: Mapping[str, Any]
    root: str
    progress: str
    home: str | None = None

    @property
    def name(self) -> str:
        """Readable name of the run."""
        return f"{self.task}-{self.method}-{self.seed}"

    @property
    def journal(self) -> Path:
        """Directory of all journals; no output of a stage: DVC deletes outputs before a stage runs."""
        return Path(self.home or self.root) / ".journal"

    def checked_params(self) -> Params:
        """The parameters as a model."""
        return parse_params(dict(self.params))

    def initial_rng(self) -> np.random.Generator:
        """Draws the initial trials: the same for all methods of a task."""
        return np.random.default_rng([self.seed, _INITIAL_STREAM])

    def method_seed(self) -> int:
        """Seed of the method, whose random numbers must have nothing to do with those of the problem."""
        return int(np.random.SeedSequence([self.seed, _METHOD_STREAM]).generate_state(1, np.uint64)[0])


def budget_of(params: Params, task: str) -> Budget:
    """How much is evaluated in each run of a task.

    Raises:
        ParamsError: the parameters have no block for the task.
    """
    family = family_of(task)
    block = getattr(params.tasks, family, None)
    if block is None:
        raise ParamsError(f"tasks: no block {family!r}, which task {task!r} needs")
    budget: Budget = block.budget
    return budget


def settings_of(params: Params, task: str, method: str) -> MethodSettings:
    """Settings of a method on a task: those for all tasks, then those for the family and its setting."""
    family = getattr(params.tasks, family_of(task))
    return params.methods[method].settings | family.settings_for(method, informed=is_informed(task))


def identity_of(spec: RunSpec, params: Params, inputs: Sequence[str]) -> dict[str, Any]:
    """Everything that determines the trials of a run, as plain data.

    Args:
        spec: the run.
        params: its checked parameters.
        inputs: files that the task reads, relative to the root.

    Raises:
        ParamsError: a file is missing.
    """
    plain = params.model_dump(mode="json")
    budget, method = budget_of(params, spec.task), params.methods[spec.method]
    block = plain["tasks"][family_of(spec.task)]
    problem = block["problem"]
    if is_informed(spec.task):
        informed = block.get("informed", {})
        problem = problem | {"informed": {name: v for name, v in informed.items() if name != "settings"}}
    files = {}
    for name in inputs:
        path = Path(spec.root) / name
        if not path.is_file():
            raise ParamsError(
                f"task {spec.task!r} needs {path}, which is missing: run the stage that writes it"
            )
        files[name] = digest_file(path)
    return {
        "task": spec.task,
        "method": spec.method,
        "seed": spec.seed,
        "initial": budget.initial,
        "trials": budget.trials,
        "batch": budget.batch,
        "problem": problem,
        "algorithm": method.algorithm,
        "space": method.space,
        "settings": settings_of(params, spec.task, spec.method),
        "blocks": {name: plain[name] for name in _BLOCKS[family_of(spec.task)]},
        "inputs": files,
        "code": code_digest(family_of(spec.task), method.algorithm),
        "libraries": {name: _version(name) for name in _LIBRARIES},
    }


@lru_cache
def code_digest(family: str, algorithm: str) -> str:
    """Digest of the modules that compute a run: what the runner, the task and the algorithm import."""
    package = Path(hdsafebo.__file__).parent
    graph = ImportGraph(package.parent)
    roots = [
        package / "campaign" / "runner.py",
        graph.file_of(task_module(family)),
        graph.file_of(method_module(algorithm)),
    ]
    modules = modules_behind(roots, graph)
    return digest_paths([path for path in modules if _counts(path.relative_to(package))], package)


def _counts(module: Path) -> bool:
    return module.parts[0] != "params" and module.as_posix() not in _INDIFFERENT_MODULES


def _version(library: str) -> str | None:
    try:
        return version(library)
    except PackageNotFoundError:
        return None
