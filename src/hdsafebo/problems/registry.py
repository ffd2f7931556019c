"""From the name of a task to its problem, the space it is searched in and what is known of it.

Some tasks exist in two settings. The plain name is the paper's: what the paper gives its methods. The name
with the suffix `_informed` is what a practitioner would use. Both are tasks of their own, every method runs
in both, and methods are compared within one of them only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path

from hdsafebo.errors import UnknownNameError
from hdsafebo.params import Params, Space
from hdsafebo.problem import Codec, Problem
from hdsafebo.problems.knowledge import TaskKnowledge
from hdsafebo.typing import FloatArray

INFORMED_SUFFIX = "_informed"


@dataclass(frozen=True)
class Task:
    """One problem instance, its latent space and what else is known of it, whichever method runs.

    Attributes:
        problem: what is optimised.
        embedding: gives the embedding of the latent space from the (n, D) initial inputs (fitted on
            them, or loaded); None when the task is searched in its original space only.
        inputs: files the task reads, relative to the root (a run depends on their content).
        latent_bounds: (2, d) box of the latent space: limits of the codes of the points that the
            embedding was trained on (paper, appendix); None takes the codes of the initial trials.
        knowledge: what of all this the methods are given, in words.
        spaces: the same task searched in further spaces, by name: trials are played and judged alike.
    """

    problem: Problem
    embedding: Callable[[FloatArray], Codec] | None
    inputs: tuple[str, ...] = ()
    latent_bounds: FloatArray | None = None
    knowledge: TaskKnowledge = field(default_factory=TaskKnowledge)
    spaces: Mapping[Space, Task] = field(default_factory=dict)


_FAMILIES = {
    "synthetic": "hdsafebo.problems.synthetic",
    "hand": "hdsafebo.problems.hand",
    "body": "hdsafebo.problems.body",
    "scs": "hdsafebo.problems.stimulation",
    "digits": "hdsafebo.problems.digits",
}


def family_names() -> list[str]:
    """The families of tasks."""
    return sorted(_FAMILIES)


def family_of(task: str) -> str:
    """The family of a task: `scs_st` belongs to `scs`.

    Raises:
        UnknownNameError: no family has that name; the message lists the families.
    """
    family = task.split("_")[0]
    if family not in _FAMILIES:
        raise UnknownNameError("task", task, sorted(_FAMILIES))
    return family


def task_module(family: str) -> str:
    """The module of a family of tasks, by the name that `family_of` gives."""
    return _FAMILIES[family]


def is_informed(task: str) -> bool:
    """Whether a task is the informed setting, see the module."""
    return task.endswith(INFORMED_SUFFIX)


def make_task(name: str, params: Params, *, seed: int, root: Path) -> Task:
    """Build a task for one run.

    Every module of a family has a function `make_task` with the same signature. No method is named here: the
    problem, its latent space and all else that is known are the same for all.

    Args:
        name: task name, such as `synthetic`, `hand`, `scs_st_informed`, `digits_3`.
        params: the parameters.
        seed: seed of the run; the problem and the initial trials follow from it.
        root: directory below which the task's files lie.

    Raises:
        UnknownNameError: there is no such task.
    """
    task: Task = import_module(task_module(family_of(name))).make_task(name, params, seed=seed, root=root)
    return task
