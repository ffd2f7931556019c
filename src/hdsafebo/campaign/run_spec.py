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
from hdsafebo.campaign.provenance import digest_file, digest_paths
from hdsafebo.errors import ParamsError
from hdsafebo.params import Budget, Params, parse_params
from hdsafebo.problems.registry import family_of

# Blocks of params.yaml, modules and libraries. Whatever is not listed as indifferent counts: too much costs
# a run that begins anew after a change, too little would continue a run that means something else.
_INDIFFERENT_BLOCKS = {"profile", "tasks", "methods", "compute", "tracking", "report", "isometry"}
_INDIFFERENT_CODE = {
    "report", "session", "cli.py", "stage.py", "params.py", "profiles.py", "progress.py", "errors.py",
    "campaign/executor.py", "campaign/cluster.py", "campaign/tracking.py", "campaign/provenance.py",
    "campaign/item.py", "campaign/series.py", "campaign/progress.py", "campaign/errors.py",
    "campaign/journal.py",
}  # fmt: skip
_LIBRARIES = ("numpy", "scipy", "torch", "gpytorch", "botorch", "scikit-learn", "mujoco", "numba", "cma")
_INITIAL_STREAM, _METHOD_STREAM = 1, 2


@dataclass(frozen=True)
class RunSpec:
    """One run of a campaign.

    Attributes:
        task: name of the task.
        method: name of the method.
        seed: of the problem, the initial trials and the method.
        params: the whole of `params.yaml` as plain data.
        root: directory below which files of the task and the journal lie.
        progress: directory for signs of life, shared by the runs of a campaign.
    """

    task: str
    method: str
    seed: int
    params: Mapping[str, Any]
    root: str
    progress: str

    @property
    def name(self) -> str:
        """Readable name of the run."""
        return f"{self.task}-{self.method}-{self.seed}"

    @property
    def journal(self) -> Path:
        """Directory of all journals; no output of the pipeline, which deletes those before a stage runs."""
        return Path(self.root) / ".journal"

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
    budget = budget_of(params, spec.task)
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
        "problem": plain["tasks"][family_of(spec.task)]["problem"],
        "settings": plain["methods"][spec.method],
        "blocks": {key: value for key, value in plain.items() if key not in _INDIFFERENT_BLOCKS},
        "inputs": files,
        "code": _code_digest(),
        "libraries": {name: _version(name) for name in _LIBRARIES},
    }


@lru_cache(maxsize=1)
def _code_digest() -> str:
    package = Path(hdsafebo.__file__).parent
    modules = [path for path in package.rglob("*.py") if not _is_indifferent(path.relative_to(package))]
    return digest_paths(modules, package)


def _is_indifferent(path: Path) -> bool:
    return path.parts[0] in _INDIFFERENT_CODE or path.as_posix() in _INDIFFERENT_CODE


def _version(library: str) -> str | None:
    try:
        return version(library)
    except PackageNotFoundError:
        return None
